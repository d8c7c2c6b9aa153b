"""Server of the log protocol (LOG_*): lists the vehicle's logs and sends them in pieces of 90 bytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Never, Protocol

import msgspec

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice

PIECE_BYTES: Final = 90
PIECES_PER_S: Final = 400.0
MOST_LOGS: Final = 5000


class LogEntry(msgspec.Struct, frozen=True):
    """One log, as it is listed."""

    number: int
    size: int
    """Bytes."""
    utc_s: int = 0
    """Start time, in seconds since 1970; 0 if it is unknown."""


class Logs(Protocol):
    """The logs that a vehicle offers."""

    def entries(self) -> Sequence[LogEntry]:
        """All of them, in the order of their numbers."""

    def read(self, number: int, offset: int, size: int) -> bytes:
        """A part of one; may raise `OSError`."""

    def erase(self) -> None:
        """Erases all; may raise `OSError`."""


class LogServer(Microservice[Never]):
    """Serves logs. One is sent at a time; a new request replaces the one before.

    Args:
        own: address of this end.
        logs: the available logs.
        may_erase: whether LOG_ERASE is obeyed.
        pieces_per_s: rate at which a log is sent.
    """

    handles = frozenset({"LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE"})

    def __init__(
        self, own: Address, logs: Logs, *, may_erase: bool = False, pieces_per_s: float = PIECES_PER_S
    ) -> None:
        super().__init__(own)
        self._logs = logs
        self._may_erase = may_erase
        self._piece_s = 1.0 / pieces_per_s
        self._listed: list[tuple[LogEntry, int, int]] = []
        self._sending: tuple[int, int, int] | None = None
        """Log, offset, end."""
        self._next_s = 0.0

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a request."""
        if not self._is_for_us(message):
            return
        match message.name:
            case "LOG_REQUEST_LIST":
                self._list(message.start, message.end)
            case "LOG_REQUEST_DATA":
                self._sending = (message.id_, message.ofs, min(message.ofs + message.count, 0xFFFF_FFFF))
            case "LOG_REQUEST_END":
                self._sending = None
            case _:
                self._erase()
        self._next_s = max(self._next_s, now_s)

    def tick(self, now_s: float) -> None:
        """Sends the next entries or pieces."""
        while now_s >= self._next_s and (self._listed or self._sending is not None):
            self._next_s = max(self._next_s + self._piece_s, now_s - 10 * self._piece_s)
            if self._listed:
                entry, count, last = self._listed.pop(0)
                fields = {"id_": entry.number, "size": entry.size, "time_utc": entry.utc_s}
                self._send("LOG_ENTRY", num_logs=count, last_log_num=last, **fields)
            else:
                self._send_piece()

    def next_tick_s(self) -> float | None:
        """When the next one is due."""
        return self._next_s if self._listed or self._sending is not None else None

    def _list(self, start: int, end: int) -> None:
        entries = list(self._logs.entries())[:MOST_LOGS]
        if not entries:
            self._listed = [(LogEntry(0, 0), 0, 0)]  # says that there is none
            return
        last = entries[-1].number
        self._listed = [(entry, len(entries), last) for entry in entries if start <= entry.number <= end]

    def _send_piece(self) -> None:
        assert self._sending is not None
        number, offset, end = self._sending
        try:
            data = self._logs.read(number, offset, min(PIECE_BYTES, end - offset))
        except OSError:
            data = b""
        self._send("LOG_DATA", id_=number, ofs=offset, count=len(data), data=data)
        offset += len(data)
        # a piece that is not full says where the log ends
        self._sending = (number, offset, end) if len(data) == PIECE_BYTES and offset < end else None

    def _erase(self) -> None:
        self._sending = None
        if self._may_erase:
            try:
                self._logs.erase()
            except OSError:
                return  # the list will show what is still there
