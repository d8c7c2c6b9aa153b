"""The status notifier of a component (paper §IV-A): reports its health periodically and on every change."""

import asyncio
from collections.abc import Callable, Mapping, Sequence

from gloc3.component.deployment import ComponentRow
from gloc3.component.error_handler import ErrorHandler
from gloc3.component.lci import OPERATING, State
from gloc3.component.statistics import CycleStatistics
from gloc3.messages.envelope import ComponentStatus, Kind


class StatusNotifier:
    """Asks for a report at a set period; `changed()` gives one in between."""

    def __init__(self, loop: asyncio.AbstractEventLoop, period_s: float, report: Callable[[bool], None]) -> None:
        self._loop = loop
        self._period_s = period_s
        self._report = report
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Reports now and from now on."""
        self._timer = self._loop.call_later(self._period_s, self._periodic)
        self.changed()

    def stop(self) -> None:
        """Ends the reports."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def changed(self) -> None:
        """Reports now, because something changed."""
        self._report(False)

    def _periodic(self) -> None:
        self._timer = self._loop.call_later(self._period_s, self._periodic)
        self._report(True)


def health_report(
    row: ComponentRow,
    kind: Kind,
    state: State | None,
    errors: ErrorHandler,
    statistics: CycleStatistics,
    *,
    nominal_rate_hz: float = 0.0,
    dropped: int = 0,
    silent: Sequence[str] = (),
    values: Mapping[str, float] = {},
) -> ComponentStatus:
    """What a component's status message says."""
    last = errors.last
    return ComponentStatus(
        name=row.name,
        kind=kind,
        state=state,
        rate_hz=statistics.rate_hz if state in OPERATING else 0.0,
        nominal_rate_hz=nominal_rate_hz,
        cycle_mean_s=statistics.mean_s,
        cycle_max_s=statistics.max_s,
        cycles=statistics.cycles,
        overruns=statistics.overruns,
        errors=errors.total,
        cause=errors.last_cause,
        cause_first_s=last.first_s if last else 0.0,
        cause_last_s=last.last_s if last else 0.0,
        dropped=dropped,
        is_required=row.required,
        standby_for=row.standby_for or "",
        silent=[*silent],
        values={**values},
    )
