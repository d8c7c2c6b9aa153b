"""The onboard flight log: one JSON line ten times a second while armed, a file per flight, kept in memory."""

from collections.abc import Sequence
from typing import Final, Protocol

import msgspec

from gloc3.mavlink.services.files.log_server import LogEntry
from gloc3.messages.frames import Quaternion, Vector3

PERIOD_S: Final = 0.1
_MOST_LOGS: Final = 32
_MOST_BYTES: Final = 8_000_000
_encode = msgspec.json.Encoder().encode


class LogHeader(msgspec.Struct, frozen=True, kw_only=True):
    """The first line of a log."""

    log: int
    """Number of the log, from 1."""
    style: str
    begins_s: float
    """Seconds since boot."""
    parameters: dict[str, float]
    """All parameters at the beginning."""


class LogRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of a log."""

    t_s: float
    mode: str
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    thrust: float
    outputs: tuple[float, ...]
    is_landed: bool = False
    failsafe: str = ""
    battery: float = 1.0
    texts: Sequence[str] = ()
    """Status texts since the previous record."""


class FlightLog:
    """One flight."""

    __slots__ = ("data", "number", "utc_s")

    def __init__(self, number: int, utc_s: int) -> None:
        self.number: Final = number
        self.utc_s: Final = utc_s
        """Seconds since 1970 at its beginning; 0 where that is not known."""
        self.data: Final = bytearray()

    @property
    def name(self) -> str:
        """The file's name."""
        return f"flight_{self.number:03d}.jsonl"

    def add(self, line: LogHeader | LogRecord) -> None:
        """Adds a line; a log that is full takes no more."""
        if len(self.data) < _MOST_BYTES:
            self.data.extend(_encode(line))
            self.data.extend(b"\n")


class LogSource(Protocol):
    """An autopilot, as far as its log needs it."""

    @property
    def is_armed(self) -> bool:
        """Whether a log is written."""

    @property
    def utc_us(self) -> int:
        """Microseconds since 1970; 0 where that is not known."""

    def log_header(self, number: int, now_s: float) -> LogHeader:
        """The first line of a log."""

    def log_record(self, now_s: float, texts: Sequence[str]) -> LogRecord:
        """The next line of a log, with the status texts since the previous one."""


class FlightLogger:
    """Starts a log at arming and ends it at disarming; the oldest log is deleted when space runs out."""

    def __init__(self, source: LogSource, before: Sequence[FlightLog] = ()) -> None:
        self.logs: Final[list[FlightLog]] = list(before)
        self._source = source
        self._open: FlightLog | None = None
        self._count = max((log.number for log in before), default=0)
        self._next_s = 0.0
        self._texts: list[str] = []

    @property
    def count(self) -> int:
        """Number of the newest log, which is that of the flight; 0 before the first."""
        return self._count

    def note(self, text: str) -> None:
        """Keeps a text for the next record."""
        if self._open is not None:
            self._texts.append(text)

    def entries(self) -> list[LogEntry]:
        """All logs, in the order of their numbers."""
        return [LogEntry(log.number, len(log.data), log.utc_s) for log in self.logs]

    def read(self, number: int, offset: int, size: int) -> bytes:
        """A part of a log.

        Raises:
            FileNotFoundError: there is no log with this number.
        """
        for log in self.logs:
            if log.number == number:
                return bytes(log.data[offset : offset + size])
        raise FileNotFoundError(number)

    def erase(self) -> None:
        """Throws away every log that is not being written."""
        self.logs[:] = [log for log in self.logs if log is self._open]

    def remove(self, number: int) -> None:
        """Throws one log away; the one that is being written stays."""
        self.logs[:] = [log for log in self.logs if log.number != number or log is self._open]

    def tick(self, now_s: float) -> None:
        """Writes due records."""
        is_armed = self._source.is_armed
        if self._open is None:
            if is_armed:
                self._begin(now_s)
            return
        if not is_armed:
            self._write(self._open, now_s)
            self._open = None
        elif now_s >= self._next_s:
            self._next_s += PERIOD_S
            self._write(self._open, now_s)

    def _begin(self, now_s: float) -> None:
        self._count += 1
        if len(self.logs) >= _MOST_LOGS:
            del self.logs[0]
        log = self._open = FlightLog(self._count, self._source.utc_us // 1_000_000)
        self.logs.append(log)
        self._next_s = now_s
        log.add(self._source.log_header(self._count, now_s))

    def _write(self, log: FlightLog, now_s: float) -> None:
        log.add(self._source.log_record(now_s, tuple(self._texts)))
        self._texts.clear()
