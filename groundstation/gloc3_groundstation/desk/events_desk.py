"""Events on the desk: store all, search, export to a file."""

import asyncio
import contextlib
import csv
import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import utc_text
from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.event_search import EVERYTHING, EventFilter, Search
from gloc3_groundstation.store.event_store import EventStore, StoredEvent

SUFFIXES: Final = (".csv", ".jsonl")
AT_ONCE: Final = 4096
"""Events that are in memory together."""


class EventsDesk:
    """Keeps every event of a station, from the moment it is made."""

    def __init__(self, station: Station, store: EventStore | None = None) -> None:
        """Begins to store events.

        Args:
            station: the source of the events.
            store: storage; None to keep them in memory only.
        """
        self._station = station
        self.store: Final = EventStore() if store is None else store
        self.search = Search(self.store)
        """The operator's current search."""
        self._has_reported = False
        self._kept = 0
        self._receive_events(station.fleet, station.fleet, station.now_s())
        station.listen(self._receive_events)

    def search_for(self, wanted: EventFilter) -> None:
        """Starts another search, from the newest event on."""
        if wanted != self.search.wanted:
            self.search = Search(self.store, wanted)

    async def export(self, name: str, wanted: EventFilter = EVERYTHING) -> bool:
        """Exports matching events to a file, in the background."""
        self.store.flush()
        try:
            path = check_target(name)
            loop = asyncio.get_running_loop()
            count = await loop.run_in_executor(None, partial(export, self.store, wanted, path))
        except Refused as error:
            self._station.note("", Severity.ERROR, f"export: {error}")
            return False
        self._station.note("", Severity.INFO, f"{count:,} {'event is' if count == 1 else 'events are'} in {path}")
        return True

    def _receive_events(self, before: Fleet, after: Fleet, now_s: float) -> None:
        if after.event_count == self._kept:
            return
        for event in after.events_after(self._kept):
            self.store.add(event)
        self._kept = after.event_count
        if self.store.problem and not self._has_reported:
            self._has_reported = True
            self._station.note("", Severity.WARNING, self.store.problem)


def check_target(name: str) -> Path:
    """Checks a file name typed by the operator.

    Raises:
        Refused: it cannot be written there; says what to do.
    """
    path = Path(name.strip()).expanduser()
    if path.suffix.lower() not in SUFFIXES:
        raise Refused(f"{name!r} must end in .csv or .jsonl")
    if not path.parent.is_dir():
        raise Refused(f"there is no folder {str(path.parent)!r}")
    if path.exists():
        raise Refused(f"{str(path)!r} is there already; give another name")
    return path


def export(store: EventStore, wanted: EventFilter, path: Path) -> int:
    """Writes the events that fit, oldest first; may run in a thread beside the station.

    Args:
        store: all events.
        wanted: which of them.
        path: a file that is not there yet.

    Returns:
        How many.

    Raises:
        Refused: it cannot be written.
    """
    search = Search(store, wanted)
    search.finish()
    beside = path.with_name(f".{path.name}.new")
    try:
        with beside.open("w", encoding="utf-8", newline="") as file:
            if path.suffix.lower() == ".csv":
                file.write(_row("time_utc", *StoredEvent.__struct_fields__))
            for event in _stored(store, search):
                file.write(_csv(event) if path.suffix.lower() == ".csv" else _json(event))
        beside.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise Refused(f"{str(path)!r} cannot be written: {error.strerror or error}") from error
    return len(search)


def _stored(store: EventStore, search: Search) -> Iterator[StoredEvent]:
    count = len(search)
    for begin in range(0, count, AT_ONCE):
        numbers = [search[place] for place in range(begin, min(count, begin + AT_ONCE))]
        first = numbers[0]
        lines = store.lines(first, numbers[-1] + 1).split(b"\n")
        for number in numbers:
            yield msgspec.json.decode(lines[number - first], type=StoredEvent)


def _time(event: StoredEvent) -> str:
    return f"{utc_text(event.utc_s, '%Y-%m-%dT%H:%M:%S')}.{int(event.utc_s * 1000) % 1000:03d}Z"


def _json(event: StoredEvent) -> str:
    return msgspec.json.encode({"time_utc": _time(event), **msgspec.structs.asdict(event)}).decode() + "\n"


def _csv(event: StoredEvent) -> str:
    return _row(_time(event), *msgspec.structs.astuple(event))


def _row(*cells: object) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
