"""MAVLink FTP client: reads and writes a vehicle's files, retries lost requests and verifies written data."""

from __future__ import annotations

import struct
from collections import deque
from enum import Enum
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.round_trip import RESTLESS_S, RoundTrip
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.files.ftp import (
    DATA_BYTES,
    FolderEntry,
    FtpError,
    Operation,
    Payload,
    checksum,
    read_entries,
    read_payload,
)
from gloc3.mavlink.services.files.ftp_stream import InOrder, Sink

SILENT_S: Final = 5.0
LARGEST_BYTES: Final = 1 << 24
"""Of a file that is read into memory; larger ones need a sink."""


class FtpJob(Enum):
    """Kinds of calls."""

    LIST = "list"
    READ = "read"
    WRITE = "write"
    SIMPLE = "one question, one answer"


class FtpCall:
    """A piece of work, and what became of it."""

    __slots__ = (
        "_budget",
        "_expected",
        "_gaps",
        "_is_first",
        "_offset",
        "_order",
        "_received_s",
        "_requested",
        "_requested_s",
        "_session",
        "_steps",
        "checksum",
        "data",
        "entries",
        "job",
        "path",
        "result",
        "sink",
        "target",
        "uses_burst",
    )

    def __init__(
        self,
        job: FtpJob,
        target: Address,
        path: str,
        data: bytes = b"",
        *,
        uses_burst: bool = True,
        sink: Sink | None = None,
    ) -> None:
        self.job = job
        self.target = target
        self.path = path
        self.data = bytearray(data)
        """Data to write, or data read, unless it goes to a sink."""
        self.sink = sink
        self._order: InOrder | None = None
        self.entries: list[FolderEntry] = []
        """What a folder holds, once it has been listed."""
        self.checksum: int | None = None
        """Of the file, if requested."""
        self.result: FtpError | None = None
        """None while it is not over; `FtpError.NONE` when it went well."""
        self.uses_burst = uses_burst
        self._steps: deque[tuple[Operation, bytes, int]] = deque()
        """Requests that remain until the work is done: operation, data, offset."""
        self._session: int | None = None
        self._expected = 0
        self._gaps: deque[tuple[int, int]] = deque()
        """Parts of a file that have not come yet, begin and end."""
        self._offset = 0
        self._requested: Payload | None = None
        self._requested_s = 0.0
        self._received_s = 0.0
        self._is_first = True
        self._budget = 200

    @property
    def progress(self) -> float:
        """From 0 to 1."""
        if self.result is FtpError.NONE:
            return 1.0
        if self.job is FtpJob.WRITE:
            return self._offset / len(self.data) if self.data else 0.0
        return self.received / self._expected if self._expected else 0.0

    @property
    def received(self) -> int:
        """Bytes of the file that are here."""
        return self._expected - sum(end - begin for begin, end in self._gaps)


class FtpClient(Microservice[FtpCall]):
    """Does one call after the other; each comes back as an event when it is over."""

    handles = frozenset({"FILE_TRANSFER_PROTOCOL"})

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self._active: FtpCall | None = None
        self._waiting: deque[FtpCall] = deque()
        self._sequence = 0
        self._round_trips: dict[Address, RoundTrip] = {}

    def list(self, target: Address, path: str, *, now_s: float) -> FtpCall:
        """Lists a folder; the result is in `entries`."""
        return self._add(FtpCall(FtpJob.LIST, target, path), (Operation.LIST_DIRECTORY, _text(path), 0), now_s)

    def read(
        self, target: Address, path: str, *, now_s: float, uses_burst: bool = True, sink: Sink | None = None
    ) -> FtpCall:
        """Reads a file; the result is in `data`, or goes to a sink as it comes."""
        call = FtpCall(FtpJob.READ, target, path, uses_burst=uses_burst, sink=sink)
        return self._add(call, (Operation.OPEN_FILE_READ_ONLY, _text(path), 0), now_s)

    def write(self, target: Address, path: str, data: bytes, *, now_s: float) -> FtpCall:
        """Writes a whole file, and compares checksums behind it."""
        call = FtpCall(FtpJob.WRITE, target, path, data)
        call._budget += 3 * (len(data) // DATA_BYTES)
        return self._add(call, (Operation.CREATE_FILE, _text(path), 0), now_s)

    def remove(self, target: Address, path: str, *, now_s: float) -> FtpCall:
        """Removes a file."""
        return self._simple(target, path, Operation.REMOVE_FILE, _text(path), now_s)

    def make_folder(self, target: Address, path: str, *, now_s: float) -> FtpCall:
        """Makes a folder."""
        return self._simple(target, path, Operation.CREATE_DIRECTORY, _text(path), now_s)

    def remove_folder(self, target: Address, path: str, *, now_s: float) -> FtpCall:
        """Removes an empty folder."""
        return self._simple(target, path, Operation.REMOVE_DIRECTORY, _text(path), now_s)

    def truncate(self, target: Address, path: str, size: int, *, now_s: float) -> FtpCall:
        """Cuts a file off."""
        return self._simple(target, path, Operation.TRUNCATE_FILE, _text(path), now_s, size)

    def rename(self, target: Address, path: str, new_path: str, *, now_s: float) -> FtpCall:
        """Moves a file or folder."""
        return self._simple(target, path, Operation.RENAME, _text(path) + b"\0" + _text(new_path), now_s)

    def calculate_checksum(self, target: Address, path: str, *, now_s: float) -> FtpCall:
        """Has a file's checksum calculated; it is in `checksum`."""
        return self._simple(target, path, Operation.CALCULATE_CRC32, _text(path), now_s)

    def reset(self, target: Address, *, now_s: float) -> FtpCall:
        """Ends all sessions."""
        return self._simple(target, "", Operation.RESET_SESSIONS, b"", now_s)

    def cancel(self, call: FtpCall, now_s: float) -> None:
        """Stops a call."""
        if call in self._waiting:
            self._waiting.remove(call)
            call.result = FtpError.CANCELLED
            self._events.append(call)
        elif call is self._active:
            self._end(call, FtpError.CANCELLED, now_s)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in an answer."""
        call = self._active
        if call is None or sender != call.target or not self._is_for_us(message):
            return
        answer = read_payload(message.payload)
        requested = call._requested
        if answer is None or requested is None or answer.requested != requested.operation:
            return
        is_burst = requested.operation == Operation.BURST_READ_FILE
        if not is_burst and answer.sequence != requested.sequence + 1 & 0xFFFF:
            return
        if is_burst and answer.session != requested.session:
            return
        call._received_s = now_s
        if call._is_first and not is_burst:
            self._round_trip(call.target).answered(now_s - call._requested_s)
        if is_burst:
            self._receive_burst(call, answer, now_s)
        elif answer.operation == Operation.ACKNOWLEDGED:
            self._handle_answer(call, requested, answer, now_s)
        else:
            self._receive_refusal(call, requested, FtpError.read(answer.data), now_s)

    def tick(self, now_s: float) -> None:
        """Repeats requests, or gives up."""
        call = self._active
        if call is None or call._requested is None:
            return
        if now_s >= call._received_s + SILENT_S:
            self._end(call, FtpError.NO_ANSWER, now_s)
        elif now_s >= self._retry_s(call):
            self._round_trip(call.target).missed()
            call._budget -= 1
            if call._budget < 0:
                self._end(call, FtpError.TOO_MANY_LOSSES, now_s)
            elif call._requested.operation == Operation.BURST_READ_FILE:
                self._request_file(call, now_s)
            else:
                call._is_first, call._requested_s = False, now_s
                self._emit(call.target, call._requested)

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        call = self._active
        if call is None or call._requested is None:
            return None
        return min(self._retry_s(call), call._received_s + SILENT_S)

    def _simple(
        self, target: Address, path: str, operation: Operation, data: bytes, now_s: float, offset: int = 0
    ) -> FtpCall:
        return self._add(FtpCall(FtpJob.SIMPLE, target, path), (operation, data, offset), now_s)

    def _add(self, call: FtpCall, step: tuple[Operation, bytes, int], now_s: float) -> FtpCall:
        if len(step[1]) > DATA_BYTES:
            raise Refused(f"the path {call.path!r} is too long")
        call._steps.append(step)
        self._waiting.append(call)
        self._begin_next(now_s)
        return call

    def _begin_next(self, now_s: float) -> None:
        if self._active is None and self._waiting:
            self._active = self._waiting.popleft()
            self._active._received_s = now_s
            self._next_step(self._active, now_s)

    def _next_step(self, call: FtpCall, now_s: float) -> None:
        if not call._steps:
            self._end(call, FtpError.NONE, now_s)
            return
        operation, data, offset = call._steps.popleft()
        self._send_request(call, operation, now_s, data=data, offset=offset)

    def _send_request(
        self, call: FtpCall, operation: Operation, now_s: float, *, data: bytes = b"", offset: int = 0, size: int = -1
    ) -> None:
        self._sequence = self._sequence + 2 & 0xFFFF
        call._requested = Payload(
            sequence=self._sequence,
            session=call._session or 0,
            operation=operation,
            size=len(data) if size < 0 else size,
            offset=offset,
            data=data,
        )
        call._requested_s, call._is_first = now_s, True
        self._emit(call.target, call._requested)

    def _emit(self, target: Address, payload: Payload) -> None:
        self._send_to(target, "FILE_TRANSFER_PROTOCOL", payload=payload.encode())

    def _retry_s(self, call: FtpCall) -> float:
        timeout_s = self._round_trip(call.target).timeout_s
        if call._requested is not None and call._requested.operation == Operation.BURST_READ_FILE:
            return max(call._requested_s, call._received_s) + max(timeout_s, 0.25)
        return call._requested_s + (timeout_s if call._is_first else min(timeout_s, RESTLESS_S))

    def _handle_answer(self, call: FtpCall, requested: Payload, answer: Payload, now_s: float) -> None:
        match requested.operation:
            case Operation.LIST_DIRECTORY:
                entries, count = read_entries(answer.data)
                call.entries += entries
                if count == 0:
                    self._next_step(call, now_s)
                else:
                    offset = requested.offset + count
                    self._send_request(call, Operation.LIST_DIRECTORY, now_s, data=_text(call.path), offset=offset)
            case Operation.OPEN_FILE_READ_ONLY:
                self._opened(call, answer, now_s)
            case Operation.READ_FILE:
                self._store(call, answer.offset, answer.data)
                self._request_file(call, now_s)
            case Operation.CREATE_FILE:
                call._session = answer.session
                self._write_next(call, now_s)
            case Operation.WRITE_FILE:
                call._offset = requested.offset + requested.size
                self._write_next(call, now_s)
            case Operation.CALCULATE_CRC32:
                call.checksum = struct.unpack("<I", answer.data[:4].ljust(4, b"\0"))[0]
                if call.job is FtpJob.WRITE and call.checksum != checksum([bytes(call.data)]):
                    self._end(call, FtpError.DIFFERENT, now_s)
                else:
                    self._next_step(call, now_s)
            case _:
                if requested.operation == Operation.TERMINATE_SESSION:
                    call._session = None
                self._next_step(call, now_s)

    def _receive_refusal(self, call: FtpCall, requested: Payload, error: FtpError, now_s: float) -> None:
        if requested.operation == Operation.LIST_DIRECTORY and error is FtpError.END_OF_FILE:
            self._next_step(call, now_s)
        elif requested.operation == Operation.READ_FILE and error is FtpError.END_OF_FILE:
            self._shorten(call, requested.offset)
            self._request_file(call, now_s)
        elif requested.operation == Operation.TERMINATE_SESSION or (
            requested.operation == Operation.CALCULATE_CRC32
            and call.job is FtpJob.WRITE
            and error is FtpError.UNKNOWN_COMMAND
        ):
            self._next_step(call, now_s)  # nothing of it matters to what was wanted
        else:
            self._end(call, error, now_s)

    def _opened(self, call: FtpCall, answer: Payload, now_s: float) -> None:
        call._session = answer.session
        size = struct.unpack("<I", answer.data[:4].ljust(4, b"\0"))[0]
        if call.sink is None and size > LARGEST_BYTES:
            self._end(call, FtpError.TOO_LARGE, now_s)
            return
        begin, call._expected = 0, size
        if call.sink is None:
            call.data = bytearray(size)
        else:
            begin = min(call.sink.opened(size), size)
            call._order = InOrder(call.sink, begin)
        call._budget += 3 * (size // DATA_BYTES)
        if begin < size:
            call._gaps.append((begin, size))
        call._steps.append((Operation.TERMINATE_SESSION, b"", 0))
        self._request_file(call, now_s)

    def _request_file(self, call: FtpCall, now_s: float, *, may_burst: bool = True) -> None:
        """Requests the first missing part: the rest of the file in a burst if permitted, a gap individually."""
        if not call._gaps:
            self._next_step(call, now_s)
            return
        begin, end = call._gaps[0]
        is_rest = end == call._expected and end - begin > DATA_BYTES
        is_burst = may_burst and call.uses_burst and is_rest
        operation = Operation.BURST_READ_FILE if is_burst else Operation.READ_FILE
        self._send_request(call, operation, now_s, offset=begin, size=min(DATA_BYTES, end - begin))

    def _receive_burst(self, call: FtpCall, answer: Payload, now_s: float) -> None:
        if answer.operation == Operation.ACKNOWLEDGED:
            has_room = self._store(call, answer.offset, answer.data)
            if answer.is_burst_complete or not call._gaps or not has_room:
                self._request_file(call, now_s)
            return
        match FtpError.read(answer.data):
            case FtpError.END_OF_FILE:
                # What is still missing was lost, or lies behind the end of a file that is shorter than reported.
                self._request_file(call, now_s, may_burst=False)
            case FtpError.UNKNOWN_COMMAND:
                call.uses_burst = False
                self._request_file(call, now_s)
            case error:
                self._end(call, error, now_s)

    @staticmethod
    def _store(call: FtpCall, offset: int, data: bytes) -> bool:
        """Stores a part of the file and removes it from the gaps; False where there is no room for it yet."""
        end = min(offset + len(data), call._expected)
        if end <= offset:
            return True
        if call._order is None:
            call.data[offset:end] = data[: end - offset]
        elif not call._order.put(offset, data[: end - offset]):
            return False
        gaps: deque[tuple[int, int]] = deque()
        for gap_begin, gap_end in call._gaps:
            if end <= gap_begin or offset >= gap_end:
                gaps.append((gap_begin, gap_end))
                continue
            if gap_begin < offset:
                gaps.append((gap_begin, offset))
            if end < gap_end:
                gaps.append((end, gap_end))
        call._gaps = gaps
        if call._order is not None:
            call._order.give(gaps[0][0] if gaps else call._expected)
        return True

    @staticmethod
    def _shorten(call: FtpCall, size: int) -> None:
        """The file has become shorter than it was when it was opened."""
        call._expected = size
        del call.data[size:]
        call._gaps = deque((begin, min(end, size)) for begin, end in call._gaps if begin < size)
        if call._order is not None:
            call._order.give(call._gaps[0][0] if call._gaps else size)

    def _write_next(self, call: FtpCall, now_s: float) -> None:
        piece = bytes(call.data[call._offset : call._offset + DATA_BYTES])
        if piece:
            self._send_request(call, Operation.WRITE_FILE, now_s, data=piece, offset=call._offset)
        else:
            call._steps.append((Operation.TERMINATE_SESSION, b"", 0))
            call._steps.append((Operation.CALCULATE_CRC32, _text(call.path), 0))
            self._next_step(call, now_s)

    def _end(self, call: FtpCall, result: FtpError, now_s: float) -> None:
        if call._session is not None and result is not FtpError.NONE:
            self._send_request(call, Operation.TERMINATE_SESSION, now_s)  # once; a lost one expires at the other end
        call._requested = None
        call.result = result
        self._active = None
        self._events.append(call)
        self._begin_next(now_s)

    def _round_trip(self, target: Address) -> RoundTrip:
        return self._round_trips.setdefault(target, RoundTrip())


def _text(path: str) -> bytes:
    return path.encode("utf-8", "surrogateescape")
