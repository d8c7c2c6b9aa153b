"""A filter over a store of events, evaluated in slices from the newest on, so that it never blocks."""

from array import array
from bisect import bisect_left
from collections.abc import Iterator
from typing import Final

import msgspec

from gloc3.messages.envelope import Severity
from gloc3_groundstation.station.snapshots import FleetEvent
from gloc3_groundstation.store.event_store import EventStore

SLICE: Final = 4096
"""Events evaluated in one step: some milliseconds."""
STATION: Final = "station"
"""Name of the station itself in the list of components."""


class EventFilter(msgspec.Struct, frozen=True, kw_only=True):
    """Filter of events; the defaults match everything."""

    severity: Severity = Severity.DEBUG
    """At least as bad as this."""
    platform: str = ""
    component: str = ""
    """`station` for events of the station itself."""
    text: str = ""
    """In the text, the vehicle's name or the component's; upper and lower case are the same."""

    @property
    def is_everything(self) -> bool:
        """Whether every event passes."""
        return self == EVERYTHING

    def fits(self, event: FleetEvent) -> bool:
        """Whether an event passes."""
        return (
            event.severity <= self.severity
            and (not self.platform or event.platform == self.platform)
            and (not self.component or (event.source or STATION) == self.component)
            and self.has_text(event)
        )

    def has_text(self, event: FleetEvent) -> bool:
        """Whether an event contains the searched text."""
        wanted = self.text.lower()
        return any(wanted in part.lower() for part in (event.text, event.platform, event.source))


EVERYTHING: Final = EventFilter()


class Search:
    """Numbers of matching events, oldest first, as far as they have been found.

    It is a sequence that grows at both ends: `step` evaluates new events, and then the next older slice.
    """

    def __init__(self, store: EventStore, wanted: EventFilter = EVERYTHING) -> None:
        """Starts with the newest events.

        Args:
            store: the store.
            wanted: the filter.
        """
        self.wanted: Final = wanted
        self._store = store
        self._begin()

    def _begin(self) -> None:
        self._generation = self._store.generation
        self._upper = self._lower = len(self._store)
        self._older: array[int] = array("I")
        self._newer: array[int] = array("I")

    def __len__(self) -> int:
        if self.wanted.is_everything:
            return len(self._store)
        return len(self._older) + len(self._newer)

    def __iter__(self) -> Iterator[int]:
        return (self[place] for place in range(len(self)))

    def __getitem__(self, place: int) -> int:
        if self.wanted.is_everything:
            return place
        older = len(self._older)
        return self._older[older - 1 - place] if place < older else self._newer[place - older]

    @property
    def share(self) -> float:
        """Share of the store that has been evaluated, 0 to 1."""
        total = len(self._store)
        return 1.0 if self.is_done else (self._upper - self._lower) / total

    @property
    def is_done(self) -> bool:
        """Whether the whole store has been evaluated."""
        if self.wanted.is_everything:
            return True
        return self._lower == 0 and self._upper == len(self._store) and self._generation == self._store.generation

    def place(self, number: int) -> int:
        """Where the event of a number is, or the next one that fits."""
        return bisect_left(self, number)

    def step(self) -> bool:
        """Evaluates one more slice; returns whether there is more."""
        if self._generation != self._store.generation:
            self._begin()
        if self.is_done:
            return False
        if self._upper < len(self._store):
            last = min(len(self._store), self._upper + SLICE)
            self._newer.extend(self._found(self._upper, last))
            self._upper = last
        else:
            first = max(0, self._lower - SLICE)
            self._older.extend(reversed(self._found(first, self._lower)))
            self._lower = first
        return not self.is_done

    def finish(self) -> None:
        """Looks at all that is left."""
        while self.step():
            pass

    def _found(self, first: int, last: int) -> list[int]:
        store, wanted = self._store, self.wanted
        worst = wanted.severity
        if worst is Severity.DEBUG:
            found = list(range(first, last))
        else:
            found = [first + n for n, severity in enumerate(store.severities[first:last]) if severity <= worst]
        if found and wanted.platform:
            wanted_platform = _index(store.platforms, wanted.platform)
            found = [n for n in found if store.platform_of[n] == wanted_platform]
        if found and wanted.component:
            name = "" if wanted.component == STATION else wanted.component
            wanted_component = _index(store.components, name)
            found = [n for n in found if store.component_of[n] == wanted_component]
        return self._with_text(found) if found and wanted.text else found

    def _with_text(self, candidates: list[int]) -> list[int]:
        """Candidates whose line contains the text; most do not, so lines are first searched as bytes."""
        store, wanted = self._store, self.wanted
        first = candidates[0]
        data = store.lines(first, candidates[-1] + 1)
        needle = msgspec.json.encode(wanted.text.lower()).decode()[1:-1].lower()
        if needle not in data.decode(errors="replace").lower():
            return []
        lines = data.split(b"\n")
        found = []
        for number in candidates:
            line = lines[number - first]
            if needle in line.decode(errors="replace").lower() and wanted.has_text(store.decode(line)):
                found.append(number)
        return found


def _index(names: list[str], name: str) -> int:
    return names.index(name) if name in names else -1
