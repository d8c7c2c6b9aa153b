"""The state of the platform's components, and its summary for the stations (paper §V)."""

from collections.abc import Mapping, Sequence
from typing import Final

from gloc3.component.deployment import Begin, ComponentRow
from gloc3.component.lci import OPERATING, State
from gloc3.messages.envelope import ComponentStatus
from gloc3.messages.software import own_software
from gloc3.messages.status_fields import COLUMN_FIELDS, ROW_FIELDS
from gloc3.messages.summaries import (
    ComponentLine,
    ComponentTable,
    ComponentTrouble,
    Health,
    Summary,
    TableRow,
    health_of,
)

SILENT_PERIODS: Final = 3.0
"""Status periods without a report after which a component counts as absent."""
SETTLED_S: Final = 0.2
"""A component that has just come up is not relied upon before this time: it has not seen its inputs yet."""
FRESH_S: Final = 0.5
"""Time after its start within which a component reports its outputs, s."""
HEALTHS: Final = tuple(Health)


class ComponentBook:
    """The last status of every component of the deployment.

    Args:
        rows: the deployment.
        process: a random number of this process.
        platform: the digest of the platform file.
    """

    def __init__(self, rows: Sequence[ComponentRow], process: int = 0, platform: str = "") -> None:
        self._process, self._platform = process, platform
        self.rows: Final[Mapping[str, ComponentRow]] = {row.name: row for row in rows}
        self._status: dict[str, ComponentStatus] = {}
        self._received_s: dict[str, float] = {}
        self._up_s: dict[str, float] = {}
        """Since when a component is working or quiet."""
        self._seen_up: set[str] = set()
        """The components that were seen working, quiet, faulty, or leaving."""
        self._working: frozenset[str] = frozenset()
        self._down: tuple[str, ...] = ()
        self._until_s = float("-inf")
        """What was last found out holds until then, unless a state changes."""
        self._reported_errors: dict[str, int] = {}
        self._troubled: dict[str, None] = {}
        """Components with new errors since the last query."""
        self._table = 0
        """Grows with each change of the table, so that indices are never read by an older one."""
        self.silent: frozenset[tuple[str, str]] = frozenset()
        """Working components and their topics that have been silent for too long."""

    def receive(self, status: ComponentStatus, now_s: float) -> None:
        """Takes a status in; of a component that is not in the deployment nothing is kept."""
        if status.name in self.rows:
            before = self._status.get(status.name)
            if before is None or before.state is not status.state or status.name in self._down:
                self._until_s = float("-inf")
            if before is None or (before.kind, before.nominal_rate_hz) != (status.kind, status.nominal_rate_hz):
                self._table += 1
            if status.errors != self._reported_errors.get(status.name, 0):
                self._troubled[status.name] = None
            if status.silent != (before.silent if before is not None else []):
                others = {pair for pair in self.silent if pair[0] != status.name}
                self.silent = frozenset(others | {(status.name, topic) for topic in status.silent})
            self._status[status.name] = status
            self._received_s[status.name] = now_s
            if status.state not in (State.IDLE, State.STANDBY):
                self._seen_up.add(status.name)
            if status.state in OPERATING:
                self._up_s.setdefault(status.name, now_s)
            else:
                self._up_s.pop(status.name, None)

    def stalled(self, by_s: float) -> None:
        """The process has stalled for so long: no component could report in that time."""
        self._received_s = {name: received_s + by_s for name, received_s in self._received_s.items()}
        self._until_s = float("-inf")

    def lose(self, name: str) -> None:
        """Marks a component as unreachable: it counts as silent."""
        if name in self._received_s:
            self._received_s[name] = self._until_s = float("-inf")
            self._up_s.pop(name, None)

    def status(self, name: str) -> ComponentStatus | None:
        """The last status of a component."""
        return self._status.get(name)

    def state(self, name: str, now_s: float) -> State | None:
        """The state of a component; None if it has left or is silent."""
        status = self._status.get(name)
        return None if status is None or now_s > self._silent_at_s(name) else status.state

    def is_working(self, name: str, now_s: float) -> bool:
        """Whether a component is there and working, and has been up long enough to have seen its inputs."""
        return name in self.working(now_s)

    def is_coming_up(self, now_s: float) -> bool:
        """Whether a component that its row brings up was never up, or has only just come up; faulty ones have been up."""
        return any(
            row.begin in (Begin.WORKING, Begin.QUIET)
            and (name not in self._seen_up or now_s < self._up_s.get(name, float("-inf")) + FRESH_S)
            for name, row in self.rows.items()
        )

    def working(self, now_s: float) -> frozenset[str]:
        """The components that work, and have been up long enough to have seen their inputs."""
        self._update(now_s)
        return self._working

    def down(self, now_s: float) -> tuple[str, ...]:
        """Components that are faulty, have left or are silent; never those that were not heard yet."""
        self._update(now_s)
        return self._down

    def _silent_at_s(self, name: str) -> float:
        return self._received_s[name] + SILENT_PERIODS * self.rows[name].status_period_s + 0.5

    def _update(self, now_s: float) -> None:
        """Finds out which components work and which are down, when that may have changed."""
        if now_s < self._until_s:
            return
        working, down, until_s = [], [], float("inf")
        for name in self.rows:
            state = self.state(name, now_s)
            if state is not None:
                until_s = min(until_s, self._silent_at_s(name))
            if state is State.WORKING:
                settled_s = self._up_s[name] + SETTLED_S
                if now_s >= settled_s:
                    working.append(name)
                else:
                    until_s = min(until_s, settled_s)
            elif state in (State.FAULTY, None) and name in self._status:
                down.append(name)
        self._working, self._down, self._until_s = frozenset(working), tuple(down), until_s

    def table(self) -> ComponentTable:
        """The names behind the summary's indices."""
        rows = [
            TableRow(
                row.name,
                status.kind.value if (status := self._status.get(row.name)) else "",
                status.nominal_rate_hz if status else 0.0,
                row.required,
                row.standby_for or "",
                _is_triggered(row, status),
            )
            for row in self.rows.values()
        ]
        return ComponentTable(
            table=self._table, rows=rows, **own_software()._asdict(), process=self._process, platform=self._platform
        )

    def summary(self, health: Health, now_s: float) -> Summary:
        """All components, a short line each."""
        lines, statuses = [], [self._status.get(name) for name in self.rows]
        for index, name in enumerate(self.rows):
            status = statuses[index]
            values = [0 if status is None else field.value(status) or 0 for field in ROW_FIELDS]
            lines.append(ComponentLine(index, HEALTHS.index(health_of(self.state(name, now_s))), *values))
        columns = {
            field.name: [field.value(status) if status else None for status in statuses] for field in COLUMN_FIELDS
        }
        reported = {name: values for name, values in columns.items() if any(value is not None for value in values)}
        return Summary(table=self._table, health=health, lines=lines, columns=reported)

    def new_problems(self) -> list[ComponentTrouble]:
        """Last errors, as text, of components with new errors since the last query."""
        problems = []
        for name in self._troubled:
            status = self._status[name]
            if status.errors > self._reported_errors.get(name, 0):
                problems.append(ComponentTrouble(name=name, cause=status.cause, errors=status.errors))
            self._reported_errors[name] = status.errors
        self._troubled.clear()
        return problems


def _is_triggered(row: ComponentRow, status: ComponentStatus | None) -> bool:
    """Whether a component's rate also depends on triggers."""
    if not row.triggers:
        return False
    return row.rate_hz is None or (status is not None and row.rate_hz < status.nominal_rate_hz)
