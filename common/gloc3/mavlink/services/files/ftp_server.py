"""Server of MAVLink FTP: serves files, and repeats its answer to a repeated request."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final, Never

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.files.ftp import (
    DATA_BYTES,
    Checksum,
    FtpError,
    Operation,
    Payload,
    error_data,
    read_payload,
)
from gloc3.mavlink.services.files.ftp_files import Files

MOST_SESSIONS: Final = 8
IDLE_S: Final = 60.0
"""Idle time after which a session may be closed for another, s."""
MOST_CLIENTS: Final = 16
REPEATED_WITHIN_S: Final = 5.0
"""Time after an answer within which the same request is a repeat, s: as long as our client repeats it. Later it is one of
a program that has been started again, whose sequence begins again too."""
BURST_PACKETS: Final = 100
"""Packets after which a burst ends, and the client requests the next."""
PACKETS_PER_S: Final = 400.0
CHECKED_BYTES: Final = 1 << 16
"""So much of a file is read at a time for its checksum, that nothing else waits for long."""
CHECK_PAUSE_S: Final = 0.002


class _Session:
    """An open file."""

    __slots__ = ("is_writable", "last_s", "owner", "path", "size")

    def __init__(self, owner: Address, path: str, size: int, now_s: float, *, is_writable: bool) -> None:
        self.owner = owner
        self.path = path
        self.size = size
        self.is_writable = is_writable
        self.last_s = now_s


class _Burst:
    """A file being sent in a burst, without a request for each part."""

    __slots__ = ("left", "next_s", "offset", "path", "piece", "request", "sender", "sequence")

    def __init__(self, request: Payload, sender: Address, path: str, now_s: float) -> None:
        self.request = request
        self.sender = sender
        self.path = path
        self.offset = request.offset
        self.piece = request.size or DATA_BYTES
        self.sequence = request.sequence
        self.left = BURST_PACKETS
        self.next_s = now_s


class _Check:
    """A checksum that is being calculated."""

    __slots__ = ("crc", "next_s", "offset", "path", "request", "sender")

    def __init__(self, request: Payload, sender: Address, path: str, now_s: float) -> None:
        self.request = request
        self.sender = sender
        self.path = path
        self.offset = 0
        self.crc = Checksum()
        self.next_s = now_s


_CHANGES: Final = frozenset(
    {
        Operation.CREATE_FILE,
        Operation.WRITE_FILE,
        Operation.REMOVE_FILE,
        Operation.CREATE_DIRECTORY,
        Operation.REMOVE_DIRECTORY,
        Operation.OPEN_FILE_WRITE_ONLY,
        Operation.TRUNCATE_FILE,
        Operation.RENAME,
    }
)


def admit_all(_sender: Address) -> bool:
    """Allows all senders to change files."""
    return True


class FtpServer(Microservice[Never]):
    """MAVLink FTP server.

    Args:
        own: address of this end.
        files: the accessible files.
        admits: whether a sender may change files now.
        packets_per_s: rate of a burst.
    """

    handles = frozenset({"FILE_TRANSFER_PROTOCOL"})

    def __init__(
        self,
        own: Address,
        files: Files,
        *,
        admits: Callable[[Address], bool] = admit_all,
        packets_per_s: float = PACKETS_PER_S,
    ) -> None:
        super().__init__(own)
        self._admits = admits
        self._files = files
        self._packet_s = 1.0 / packets_per_s
        self._sessions: dict[int, _Session] = {}
        self._bursts: dict[int, _Burst] = {}
        self._checks: dict[Address, _Check] = {}
        self._answered: dict[Address, tuple[Payload, Payload, float]] = {}
        """Last request of each client, its answer, and when it was given."""
        self._answers: dict[int, Callable[[Payload, Address, float], Payload | None]] = {
            Operation.NONE: lambda request, _sender, _now_s: _acknowledge(request),
            Operation.TERMINATE_SESSION: self._terminate,
            Operation.RESET_SESSIONS: self._reset,
            Operation.LIST_DIRECTORY: self._list,
            Operation.OPEN_FILE_READ_ONLY: self._open_to_read,
            Operation.READ_FILE: self._read,
            Operation.CREATE_FILE: self._create,
            Operation.WRITE_FILE: self._write,
            Operation.OPEN_FILE_WRITE_ONLY: self._open_to_write,
            Operation.RENAME: self._rename,
            Operation.CALCULATE_CRC32: self._checksum,
            Operation.BURST_READ_FILE: self._begin_burst,
            Operation.REMOVE_FILE: self._simple(lambda path, _: files.remove(path)),
            Operation.CREATE_DIRECTORY: self._simple(lambda path, _: files.make_folder(path)),
            Operation.REMOVE_DIRECTORY: self._simple(lambda path, _: files.remove_folder(path)),
            Operation.TRUNCATE_FILE: self._simple(files.truncate),
        }

    @property
    def sessions(self) -> int:
        """Files that are open."""
        return len(self._sessions)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a question and answers it."""
        if not self._is_for_us(message):
            return
        request = read_payload(message.payload)
        if request is None or request.operation >= Operation.ACKNOWLEDGED:
            return
        before = self._answered.get(sender)
        if before is not None and before[0] == request and now_s < before[2] + REPEATED_WITHIN_S:
            self._reply(sender, before[1])
            return
        work = self._answers.get(request.operation)
        try:
            if work is None:
                answer: Payload | None = _refuse(request, FtpError.UNKNOWN_COMMAND)
            elif request.operation in _CHANGES and not self._admits(sender):
                answer = _refuse(request, FtpError.FILE_PROTECTED)
            else:
                answer = work(request, sender, now_s)
        except OSError as error:
            answer = _refuse_with(request, error_data(error))
        except ValueError:  # a path that is no text, or holds what no path can
            answer = _refuse(request, FtpError.FILE_NOT_FOUND)
        if answer is not None:
            self._answer(request, sender, answer, now_s)

    def _answer(self, request: Payload, sender: Address, answer: Payload, now_s: float) -> None:
        """Answers, and remembers the answer for a repeated request."""
        self._answered.pop(sender, None)
        if len(self._answered) >= MOST_CLIENTS:
            del self._answered[next(iter(self._answered))]
        self._answered[sender] = (request, answer, now_s)
        self._reply(sender, answer)

    def tick(self, now_s: float) -> None:
        """Sends the next packets of the bursts, and continues checksums."""
        for number, burst in list(self._bursts.items()):
            while number in self._bursts and now_s >= burst.next_s:
                burst.next_s = max(burst.next_s + self._packet_s, now_s - 10 * self._packet_s)
                self._send_next(number, burst, now_s)
        for check in [check for check in self._checks.values() if now_s >= check.next_s]:
            answer = self._go_on(check, now_s)
            if answer is not None:
                self._answer(check.request, check.sender, answer, now_s)

    def next_tick_s(self) -> float | None:
        """When the next packet, or piece of a checksum, is due."""
        bursts, checks = self._bursts.values(), self._checks.values()
        return min([*(burst.next_s for burst in bursts), *(check.next_s for check in checks)], default=None)

    def _reply(self, target: Address, answer: Payload) -> None:
        self._send_to(target, "FILE_TRANSFER_PROTOCOL", payload=answer.encode())

    def _session(self, request: Payload, sender: Address, now_s: float) -> _Session | None:
        session = self._sessions.get(request.session)
        if session is None or session.owner != sender:
            return None
        session.last_s = now_s
        return session

    def _open(self, request: Payload, sender: Address, now_s: float, *, is_writable: bool) -> Payload:
        path = _path(request.data)
        size = self._files.size(path)
        number = self._free_session(now_s)
        if number is None:
            return _refuse(request, FtpError.NO_SESSIONS_AVAILABLE)
        self._sessions[number] = _Session(sender, path, size, now_s, is_writable=is_writable)
        return _acknowledge(request, struct.pack("<I", min(size, 0xFFFF_FFFF)), session=number)

    def _free_session(self, now_s: float) -> int | None:
        for number in range(MOST_SESSIONS):
            session = self._sessions.get(number)
            if session is None:
                return number
            if now_s >= session.last_s + IDLE_S:
                self._close(number)
                return number
        return None

    def _close(self, number: int) -> None:
        self._sessions.pop(number, None)
        self._bursts.pop(number, None)

    def _open_to_read(self, request: Payload, sender: Address, now_s: float) -> Payload:
        return self._open(request, sender, now_s, is_writable=False)

    def _open_to_write(self, request: Payload, sender: Address, now_s: float) -> Payload:
        return self._open(request, sender, now_s, is_writable=True)

    def _create(self, request: Payload, sender: Address, now_s: float) -> Payload:
        self._files.create(_path(request.data))
        return self._open(request, sender, now_s, is_writable=True)

    def _terminate(self, request: Payload, sender: Address, now_s: float) -> Payload:
        if self._session(request, sender, now_s) is None:
            return _refuse(request, FtpError.INVALID_SESSION)
        self._close(request.session)
        return _acknowledge(request)

    def _reset(self, request: Payload, sender: Address, _now_s: float) -> Payload:
        for number in [number for number, session in self._sessions.items() if session.owner == sender]:
            self._close(number)
        return _acknowledge(request)

    def _list(self, request: Payload, _sender: Address, _now_s: float) -> Payload:
        entries = self._files.entries(_path(request.data))[request.offset :]
        if not entries:
            return _refuse(request, FtpError.END_OF_FILE)
        data = b""
        for entry in entries:
            encoded = entry.encode()
            if len(encoded) > DATA_BYTES:
                encoded = b"S\0"  # its name does not fit
            if len(data) + len(encoded) > DATA_BYTES:
                break
            data += encoded
        return _acknowledge(request, data)

    def _read(self, request: Payload, sender: Address, now_s: float) -> Payload:
        session = self._session(request, sender, now_s)
        if session is None:
            return _refuse(request, FtpError.INVALID_SESSION)
        self._bursts.pop(request.session, None)
        data = self._files.read(session.path, request.offset, request.size or DATA_BYTES)
        return _acknowledge(request, data) if data else _refuse(request, FtpError.END_OF_FILE)

    def _write(self, request: Payload, sender: Address, now_s: float) -> Payload:
        session = self._session(request, sender, now_s)
        if session is None:
            return _refuse(request, FtpError.INVALID_SESSION)
        if not session.is_writable:
            return _refuse(request, FtpError.FILE_PROTECTED)
        self._files.write(session.path, request.offset, request.data)
        return _acknowledge(request, struct.pack("<I", request.size))

    def _rename(self, request: Payload, _sender: Address, _now_s: float) -> Payload:
        before, separator, rest = request.data.partition(b"\0")
        if not separator:
            return _refuse(request, FtpError.INVALID_DATA_SIZE)
        self._files.rename(_path(before), _path(rest))
        return _acknowledge(request)

    def _checksum(self, request: Payload, sender: Address, now_s: float) -> Payload | None:
        path, running = _path(request.data), self._checks.get(sender)
        if running is not None and running.path == path:
            running.request = request  # asked again while it is being calculated
            return None
        self._checks.pop(sender, None)
        self._files.size(path)
        if len(self._checks) >= MOST_SESSIONS:
            return _refuse(request, FtpError.NO_SESSIONS_AVAILABLE)
        check = self._checks[sender] = _Check(request, sender, path, now_s)
        return self._go_on(check, now_s)

    def _go_on(self, check: _Check, now_s: float) -> Payload | None:
        """Takes the next piece of a file into its checksum; the answer, when it was the last one."""
        try:
            piece = self._files.read(check.path, check.offset, CHECKED_BYTES)
        except OSError as error:
            del self._checks[check.sender]
            return _refuse_with(check.request, error_data(error))
        check.crc.add(piece)
        check.offset += len(piece)
        check.next_s = now_s + CHECK_PAUSE_S
        if len(piece) == CHECKED_BYTES:
            return None
        del self._checks[check.sender]
        return _acknowledge(check.request, struct.pack("<I", check.crc.value))

    @staticmethod
    def _simple(work: Callable[[str, int], None]) -> Callable[[Payload, Address, float], Payload]:
        def answer(request: Payload, _sender: Address, _now_s: float) -> Payload:
            work(_path(request.data), request.offset)
            return _acknowledge(request)

        return answer

    def _begin_burst(self, request: Payload, sender: Address, now_s: float) -> Payload | None:
        session = self._session(request, sender, now_s)
        if session is None:
            return _refuse(request, FtpError.INVALID_SESSION)
        self._bursts[request.session] = _Burst(request, sender, session.path, now_s)
        return None  # its answers come by and by

    def _send_next(self, number: int, burst: _Burst, now_s: float) -> None:
        self._sessions[number].last_s = now_s
        burst.left -= 1
        burst.sequence += 1
        try:
            data = self._files.read(burst.path, burst.offset, burst.piece)
        except OSError as error:
            data, failure = b"", error_data(error)
        else:
            failure = bytes([FtpError.END_OF_FILE])
        is_over = not data or burst.left == 0
        answer = Payload(
            sequence=burst.sequence,
            session=number,
            operation=Operation.ACKNOWLEDGED if data else Operation.REFUSED,
            size=len(data or failure),
            requested=Operation.BURST_READ_FILE,
            is_burst_complete=is_over,
            offset=burst.offset,
            data=data or failure,
        )
        burst.offset += len(data)
        if is_over:
            del self._bursts[number]
        self._reply(burst.sender, answer)


def _path(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("utf-8", "surrogateescape")


def _acknowledge(request: Payload, data: bytes = b"", *, session: int | None = None) -> Payload:
    return Payload(
        sequence=request.sequence + 1 & 0xFFFF,
        session=request.session if session is None else session,
        operation=Operation.ACKNOWLEDGED,
        size=len(data),
        requested=request.operation,
        offset=request.offset,
        data=data,
    )


def _refuse(request: Payload, error: FtpError) -> Payload:
    return _refuse_with(request, bytes([error]))


def _refuse_with(request: Payload, data: bytes) -> Payload:
    return Payload(
        sequence=request.sequence + 1 & 0xFFFF,
        session=request.session,
        operation=Operation.REFUSED,
        size=len(data),
        requested=request.operation,
        offset=request.offset,
        data=data,
    )
