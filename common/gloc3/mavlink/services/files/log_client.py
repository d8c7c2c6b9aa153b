"""Client of the log protocol (LOG_*): downloads a vehicle's logs; gaps are requested again."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, TypeAlias

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.files.log_server import MOST_LOGS, PIECE_BYTES, LogEntry

QUIET_S: Final = 0.4
"""Pause after which missing pieces are requested, s."""
SILENT_S: Final = 5.0
LARGEST_BYTES: Final = 1 << 26
"""At 90 bytes a piece, more than this is a matter for file transfer."""
ALL: Final = 0xFFFF


class LogResult(StrEnum):
    """Results of requests; the text is for a person."""

    DONE = "done"
    NO_ANSWER = "no answer"
    TOO_MANY_LOSSES = "gave up after repeated packet loss"
    TOO_LARGE = "the log is too large"
    CANCELLED = "cancelled"


class LogList:
    """A vehicle's logs being listed."""

    __slots__ = ("_budget", "_count", "_last", "_received_s", "_requested_s", "entries", "result", "target")

    def __init__(self, target: Address, now_s: float) -> None:
        self.target = target
        self.entries: dict[int, LogEntry] = {}
        """By number."""
        self.result: LogResult | None = None
        """None while it is not over."""
        self._count: int | None = None
        self._last = 0
        self._requested_s = self._received_s = now_s
        self._budget = 50


class LogDownload:
    """A log being read."""

    __slots__ = ("_budget", "_missing", "_received_s", "_requested_s", "data", "entry", "result", "target")

    def __init__(self, target: Address, entry: LogEntry, now_s: float, begun: bytes = b"") -> None:
        self.target = target
        self.entry = entry
        self.data = bytearray(entry.size)
        """What has come so far; holes are zeros."""
        self.result: LogResult | None = None
        """None while it is not over."""
        kept = min(len(begun), entry.size) // PIECE_BYTES * PIECE_BYTES if len(begun) < entry.size else entry.size
        self.data[:kept] = begun[:kept]
        self._missing = dict.fromkeys(range(kept, entry.size, PIECE_BYTES))
        self._requested_s = self._received_s = now_s
        self._budget = 100 + entry.size // PIECE_BYTES

    @property
    def progress(self) -> float:
        """From 0 to 1."""
        size = self.entry.size
        return 1.0 - len(self._missing) * PIECE_BYTES / (size + PIECE_BYTES) if self._missing else 1.0

    @property
    def whole_bytes(self) -> int:
        """Bytes received from the start without a gap."""
        return next(iter(self._missing), self.entry.size)


LogEvent: TypeAlias = LogList | LogDownload


class LogClient(Microservice[LogEvent]):
    """Lists and reads logs, one request at a time; it comes back as an event when it is over."""

    handles = frozenset({"LOG_ENTRY", "LOG_DATA"})

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self._active: LogEvent | None = None

    def list(self, target: Address, *, now_s: float) -> LogList:
        """Lists the logs.

        Raises:
            Refused: another request is under way.
        """
        self._check_idle()
        listing = LogList(target, now_s)
        self._active = listing
        self._send_to(target, "LOG_REQUEST_LIST", start=0, end=ALL)
        return listing

    def read(self, target: Address, entry: LogEntry, *, now_s: float, begun: bytes = b"") -> LogDownload:
        """Reads a log.

        Args:
            target: the vehicle.
            entry: the log, as listed.
            now_s: now.
            begun: the part that is already stored here, from its start; it is not requested again.

        Raises:
            Refused: another request is under way, or the log is too large.
        """
        self._check_idle()
        if entry.size > LARGEST_BYTES:
            raise Refused(f"log {entry.number}: {LogResult.TOO_LARGE}")
        download = LogDownload(target, entry, now_s, begun)
        self._active = download
        if not download._missing:
            self._end(download, LogResult.DONE)
        else:
            self._request_data(download, now_s)
        return download

    def erase_all(self, target: Address) -> None:
        """Asks a vehicle to erase all logs; it does not answer."""
        self._send_to(target, "LOG_ERASE")

    def cancel(self) -> None:
        """Cancels the request under way."""
        if self._active is not None:
            self._end(self._active, LogResult.CANCELLED)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in an entry or a piece."""
        active = self._active
        if active is None or sender != active.target:
            return
        if isinstance(active, LogList):
            if message.name == "LOG_ENTRY":
                self._receive_entry(active, message, now_s)
        elif message.name == "LOG_DATA" and message.id_ == active.entry.number:
            self._receive_piece(active, message, now_s)

    def tick(self, now_s: float) -> None:
        """Requests missing data, or gives up."""
        active = self._active
        if active is None:
            return
        if now_s >= active._received_s + SILENT_S:
            self._end(active, LogResult.NO_ANSWER)
        elif now_s >= self._quiet_s(active):
            active._budget -= 1
            if active._budget < 0:
                self._end(active, LogResult.TOO_MANY_LOSSES)
            elif isinstance(active, LogDownload):
                self._request_data(active, now_s)
            else:
                self._request_entries(active, now_s)

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        active = self._active
        return None if active is None else min(self._quiet_s(active), active._received_s + SILENT_S)

    @staticmethod
    def _quiet_s(active: LogEvent) -> float:
        return max(active._requested_s, active._received_s) + QUIET_S

    def _check_idle(self) -> None:
        if self._active is not None:
            raise Refused("logs are being listed or read")

    def _request_entries(self, listing: LogList, now_s: float) -> None:
        """Asks for all, or for what lies between the first and the last that is missing."""
        listing._requested_s = now_s
        start, end = 0, ALL
        if listing._count is not None:
            first_known = max(0, listing._last - listing._count + 1)  # numbers usually follow each other
            missing = [number for number in range(first_known, listing._last + 1) if number not in listing.entries]
            if missing:
                start, end = missing[0], missing[-1]
        self._send_to(listing.target, "LOG_REQUEST_LIST", start=start, end=end)

    def _receive_entry(self, listing: LogList, message: MavlinkMessage, now_s: float) -> None:
        listing._received_s = now_s
        listing._count, listing._last = min(message.num_logs, MOST_LOGS), message.last_log_num
        if message.num_logs:
            listing.entries[message.id_] = LogEntry(message.id_, message.size, message.time_utc)
        if len(listing.entries) >= listing._count:
            self._end(listing, LogResult.DONE)

    def _request_data(self, download: LogDownload, now_s: float) -> None:
        """Asks for the first run of missing pieces."""
        download._requested_s = now_s
        first = end = next(iter(download._missing))
        while end in download._missing:
            end += PIECE_BYTES
        count = min(end, download.entry.size) - first
        self._send_to(download.target, "LOG_REQUEST_DATA", id_=download.entry.number, ofs=first, count=count)

    def _receive_piece(self, download: LogDownload, message: MavlinkMessage, now_s: float) -> None:
        download._received_s = now_s
        offset, size = message.ofs, download.entry.size
        wanted = min(PIECE_BYTES, size - offset)
        if offset not in download._missing or message.count < wanted:
            return
        download.data[offset : offset + wanted] = message.data[:wanted]
        del download._missing[offset]
        if not download._missing:
            self._end(download, LogResult.DONE)
        elif offset + PIECE_BYTES not in download._missing:
            self._request_data(download, now_s)  # the run that was asked for is over

    def _end(self, active: LogEvent, result: LogResult) -> None:
        if isinstance(active, LogDownload):
            self._send_to(active.target, "LOG_REQUEST_END")
        active.result = result
        self._active = None
        self._events.append(active)
