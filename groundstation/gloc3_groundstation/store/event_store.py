"""Every event of a session: all of them on disk, thirteen bytes of each in memory, the last ones cached."""

import io
import tempfile
import weakref
from array import array
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import BinaryIO, Final

import msgspec

from gloc3.messages.envelope import Severity
from gloc3.store import AppendFile
from gloc3_groundstation.station.snapshots import FleetEvent

RECENT: Final = 2000
"""Events that are kept in memory whole."""
WRITE_BYTES: Final = 1 << 16
"""So much is collected before it is written; `flush` writes sooner."""
MOST_IN_MEMORY: Final = 50_000
"""Events at most where the disk takes no more."""


class StoredEvent(msgspec.Struct, frozen=True, gc=False):
    """An event as a line of the file, and of an export."""

    number: int
    utc_s: float
    """Time of reception, in seconds since 1970."""
    severity: str
    platform: str
    component: str
    """Empty for an event of the station itself."""
    text: str


_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(StoredEvent).decode


class EventStore:
    """An append-only file of events with an index in memory; numbers count from 0 and are never reused.

    When the file cannot be written any more, the store continues in memory with the last events, and increments
    `generation`.
    """

    def __init__(self, file: BinaryIO | None = None, utc_offset_s: float = 0.0) -> None:
        """Creates an empty store.

        Args:
            file: open for reading and writing, empty, unbuffered or not; None to keep events in memory only.
            utc_offset_s: UTC minus the station's time.
        """
        if file is None:
            file = tempfile.TemporaryFile()  # noqa: SIM115 - it lives as long as the store
        weakref.finalize(self, file.close)
        self._file = AppendFile(file)
        self._offset_s = utc_offset_s
        self._reset()
        self.generation = 0
        """Incremented when stored events are lost."""
        self.problem = ""
        """Why the file is no longer written."""
        self.platforms: list[str] = []
        """All that events came from, in order of appearance; the index counts."""
        self.components: list[str] = []
        """The same of their components."""

    def _reset(self) -> None:
        self.severities: array[int] = array("B")
        self.platform_of: array[int] = array("H")
        self.component_of: array[int] = array("H")
        self._ends: array[int] = array("Q")
        self._pending: list[bytes] = []
        self._pending_bytes = 0
        self._recent: deque[FleetEvent] = deque(maxlen=RECENT)

    def __len__(self) -> int:
        return len(self._ends)

    def add(self, event: FleetEvent) -> None:
        """Keeps an event."""
        number = len(self._ends)
        stored = StoredEvent(
            number + 1,
            round(event.received_s + self._offset_s, 3),
            event.severity.name.lower(),
            event.platform,
            event.source,
            event.text,
        )
        line = _encode(stored) + b"\n"
        self.severities.append(event.severity)
        self.platform_of.append(_place(self.platforms, event.platform))
        self.component_of.append(_place(self.components, event.source))
        self._ends.append((self._ends[-1] if number else 0) + len(line))
        self._recent.append(event)
        self._pending.append(line)
        self._pending_bytes += len(line)
        if self._pending_bytes >= WRITE_BYTES:
            self.flush()
        if self.problem and number >= MOST_IN_MEMORY:
            self._begin_again()

    def flush(self) -> None:
        """Writes collected events to the operating system."""
        if not self._pending:
            return
        try:
            self._file.append(b"".join(self._pending))
        except OSError as error:
            self.problem = self.problem or f"events cannot be written: {error.strerror or error}"
            self._begin_again()
            return
        self._pending.clear()
        self._pending_bytes = 0

    def close(self) -> None:
        """Writes the remaining events."""
        self.flush()
        self._file.close()

    # --- reading ---

    def events(self, numbers: Sequence[int]) -> list[FleetEvent]:
        """Events by their numbers."""
        first = len(self) - len(self._recent)
        return [self._recent[n - first] if n >= first else self._read_one(n) for n in numbers]

    def lines(self, first: int, last: int) -> bytes:
        """The lines of the events from `first` to before `last`, as they are in the file; also from other threads."""
        begin = self._ends[first - 1] if first else 0
        size = self._ends[last - 1] - begin if last > first else 0
        written = self._file.size
        if begin + size > written:
            data = b"".join(self._pending)
            return (self._pread(begin, max(0, written - begin)) + data[max(0, begin - written) :])[:size]
        return self._pread(begin, size)

    def decode(self, line: bytes) -> FleetEvent:
        """The event of a line."""
        stored = _decode(line)
        return FleetEvent(
            number=stored.number,
            platform=stored.platform,
            received_s=stored.utc_s - self._offset_s,
            severity=Severity[stored.severity.upper()],
            source=stored.component,
            text=stored.text,
        )

    def _read_one(self, number: int) -> FleetEvent:
        return self.decode(self.lines(number, number + 1))

    def _pread(self, begin: int, size: int) -> bytes:
        try:
            return self._file.read(begin, size)
        except OSError as error:
            self.problem = self.problem or f"events cannot be read: {error.strerror or error}"
            return b""

    def _begin_again(self) -> None:
        """Continues in memory, with the last events."""
        kept = list(self._recent)
        with suppress(OSError):  # what it still holds in memory does not fit either
            self._file.close()
        self._file = AppendFile(io.BytesIO())
        self._reset()
        self.generation += 1
        for event in kept:
            self.add(event)


def _place(names: list[str], name: str) -> int:
    """The index of a name; the 65,536th and later ones are counted as the first."""
    try:
        return names.index(name)
    except ValueError:
        if len(names) > 0xFFFF:
            return 0
        names.append(name)
        return len(names) - 1
