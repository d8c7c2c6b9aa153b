"""Events in a file for other programs: a table (`.csv`) or a JSON object a line (`.jsonl`)."""

import contextlib
import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import utc_text
from gloc3.errors import Refused
from gloc3_groundstation.store.event_search import EventFilter, Search
from gloc3_groundstation.store.event_store import EventStore, StoredEvent

SUFFIXES: Final = (".csv", ".jsonl")
AT_ONCE: Final = 4096
"""Events that are in memory together."""


def check_target(name: str) -> Path:
    """The file that an operator has named.

    Raises:
        Refused: it cannot be written there, with what to do.
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
