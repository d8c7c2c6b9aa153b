"""The status notifier of a component (paper §IV-A): reports its health periodically and on every change."""

import asyncio
from collections.abc import Callable


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
