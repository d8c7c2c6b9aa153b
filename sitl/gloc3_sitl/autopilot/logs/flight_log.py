"""The onboard flight log: a record ten times a second while armed, a file per flight, kept in memory."""

from collections.abc import Callable, Sequence
from typing import Final, Protocol

from gloc3.mavlink.services.files.log_server import LogEntry
from gloc3_sitl.autopilot.logs.records import LogFormat, LogHeader, LogRecord

PERIOD_S: Final = 0.1
_MOST_LOGS: Final = 32
_MOST_BYTES: Final = 8_000_000


class FlightLog:
    """One flight.

    Args:
        number: of the log, from 1.
        utc_s: seconds since 1970 at its beginning; 0 where that is not known.
        written: its format.
    """

    __slots__ = ("_format", "data", "number", "utc_s")

    def __init__(self, number: int, utc_s: int, written: LogFormat) -> None:
        self.number: Final = number
        self._format: Final = written
        self.utc_s: Final = utc_s
        self.data: Final = bytearray()

    @property
    def name(self) -> str:
        """The file's name."""
        return f"flight_{self.number:03d}{self._format.suffix}"

    def begin(self, header: LogHeader) -> None:
        """Begins the file."""
        self.data.extend(self._format.begin(header))

    def add(self, record: LogRecord) -> None:
        """Adds a record; a log that is full takes no more."""
        if len(self.data) < _MOST_BYTES:
            self.data.extend(self._format.add(record))


class LogSource(Protocol):
    """An autopilot, as far as its log needs it."""

    @property
    def is_armed(self) -> bool:
        """Whether a log is written."""

    @property
    def utc_us(self) -> int:
        """Microseconds since 1970; 0 where that is not known."""

    def log_header(self, now_s: float) -> LogHeader:
        """What a log begins with."""

    def log_record(self, now_s: float, texts: Sequence[str]) -> LogRecord:
        """The next record of a log, with the status texts since the previous one."""


class FlightLogger:
    """Starts a log at arming and ends it at disarming; the oldest log is deleted when space runs out.

    Args:
        source: the autopilot.
        make_format: makes the format of a new log.
        before: logs on the memory card.
    """

    def __init__(
        self, source: LogSource, make_format: Callable[[], LogFormat], before: Sequence[FlightLog] = ()
    ) -> None:
        self.logs: Final[list[FlightLog]] = list(before)
        self._source, self._make_format = source, make_format
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
        log = self._open = FlightLog(self._count, self._source.utc_us // 1_000_000, self._make_format())
        self.logs.append(log)
        self._next_s = now_s
        log.begin(self._source.log_header(now_s))

    def _write(self, log: FlightLog, now_s: float) -> None:
        log.add(self._source.log_record(now_s, tuple(self._texts)))
        self._texts.clear()
