"""Large messages to processes of the same user on this computer: in shared memory, announced over a socket.

The sender listens at a name that is local to this computer and ends with the process. A reader presents the ticket of a
topic, which requires read access to that topic. Then each message is announced by one packet with its slot in the
memory, which wakes the reader's loop without an extra thread. The reader acknowledges the last message that it has
read. Slots that are announced and not read are never overwritten; they are free at once when the reader dies.
"""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
import struct
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error
from gloc3.exchange.shared_slots import SharedRegion, Slots

AHEAD: Final = 16
"""So many messages may wait for one reader; more are dropped for it."""
DEPTH: Final = 8
"""Messages that a reader handles after its loop was busy, the newest ones; older ones are dropped."""
TOO_SLOW: Final = "a receiver on this computer is too slow"
LONGEST_HEAD: Final = 4096
TICKET_BYTES: Final = 16
ROOM: Final = 1.25
"""Size of a slot relative to the message for which it is allocated: the length of compressed pictures varies."""

_PACKET: Final = struct.Struct("<QQI")
"""Number, place, length; the head follows. With a file descriptor: of new memory, the length of its places."""
_READ: Final = struct.Struct("<Q")
_CREDENTIALS: Final = struct.Struct("3i")
_FILE: Final = struct.Struct("i")
_CONTROL: Final = socket.CMSG_LEN(_FILE.size)
_LONGEST: Final = _PACKET.size + LONGEST_HEAD

Receive = Callable[[bytes, bytes], None]
"""Takes a message's head, which may be empty, and its body; called in the loop."""


class NearServer:
    """Accepts readers of this process's large messages.

    Args:
        loop: watches the readers' sockets.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.name: Final = secrets.token_hex(8)
        """By which others find it."""
        self._loop = loop
        self._topics: dict[bytes, NearTopic] = {}
        self._requesting: set[socket.socket] = set()
        self._socket: socket.socket | None = None

    def open(self) -> NearTopic:
        """Opens a topic, with a ticket for its readers."""
        if self._socket is None:
            self._socket = _socket()
            self._socket.bind(_address(self.name))
            self._socket.listen(64)
            self._loop.add_reader(self._socket, self._accept, self._socket)
        topic = NearTopic()
        self._topics[topic.ticket] = topic
        return topic

    def close(self) -> None:
        """Ends all of it."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
        for other in list(self._requesting):
            self._drop(other)
            other.close()
        for topic in self._topics.values():
            topic.close()
        self._topics.clear()

    def _accept(self, server: socket.socket) -> None:
        try:
            other, _ = server.accept()
        except OSError:  # gone again
            return
        if not _is_of_own_user(other):
            other.close()
            return
        other.setblocking(False)
        self._requesting.add(other)
        self._loop.add_reader(other, self._admit, other)

    def _admit(self, other: socket.socket) -> None:
        """Takes a ticket."""
        self._drop(other)
        ticket = b""
        with suppress(OSError):
            ticket = other.recv(TICKET_BYTES)
        topic = self._topics.get(ticket)
        if topic is None:
            other.close()
        else:
            topic.add(other)

    def _drop(self, other: socket.socket) -> None:
        self._requesting.discard(other)
        self._loop.remove_reader(other)


class _Reader(NamedTuple):
    """A reader of a topic."""

    socket: socket.socket
    waiting: deque[tuple[int, int]]
    """Numbers and slots of announced messages that it has not read."""


class NearTopic:
    """Tells the readers of one topic of each message."""

    def __init__(self) -> None:
        self.ticket: Final = secrets.token_bytes(TICKET_BYTES)
        self._readers: list[_Reader] = []
        self._slots: Slots | None = None
        self._number = 0

    @property
    def readers(self) -> int:
        """How many read it."""
        return len(self._readers)

    @property
    def held(self) -> int:
        """Number of announced messages that readers have not read, as far as is known."""
        return sum(len(reader.waiting) for reader in self._readers)

    def add(self, other: socket.socket) -> None:
        """Somebody with a ticket."""
        reader = _Reader(other, deque())
        self._readers.append(reader)
        if self._slots is not None:
            self._introduce(reader, self._slots)

    def send(self, head: bytes, body: bytes) -> str:
        """Gives a message to all readers; returns why one did not get it, or an empty text. Never waits.

        Raises:
            OSError: there is no memory to share.
        """
        if not self._readers:
            return ""
        if not self._has_room():
            self._release_read()
            if not self._has_room():
                return "" if not self._readers else TOO_SLOW
        slots = self._slots
        if slots is None or len(body) > slots.slot_bytes:
            slots = self._renew(len(body))
        self._number += 1
        slot = slots.write(body, self._number)
        if slot is None:
            self._release_read()
            return "receivers hold all of the shared memory"
        packet = _PACKET.pack(self._number, slot, len(body)) + head
        reason = ""
        for reader in list(self._readers):
            if len(reader.waiting) >= AHEAD or not self._send(reader, packet):
                reason = TOO_SLOW
            else:
                slots.hold(slot)
                reader.waiting.append((self._number, slot))
        self._release_read()  # behind it, since a message is under way sooner so
        return reason

    def close(self) -> None:
        """Tells nothing any more."""
        for reader in list(self._readers):
            self._drop(reader)
        if self._slots is not None:
            self._slots.close()
            self._slots = None

    def _has_room(self) -> bool:
        """Whether a reader takes more."""
        return any(len(reader.waiting) < AHEAD for reader in self._readers)

    def _renew(self, length: int) -> Slots:
        """Allocates longer slots in new memory; messages announced before are still read from the old one."""
        slots = Slots(round(length * ROOM))
        if self._slots is not None:
            self._slots.close()
        self._slots = slots
        for reader in list(self._readers):
            reader.waiting.clear()
            self._introduce(reader, slots)
        return slots

    def _introduce(self, reader: _Reader, slots: Slots) -> None:
        packet = _PACKET.pack(0, 0, slots.slot_bytes)
        try:
            socket.send_fds(reader.socket, [packet], [slots.file])
        except OSError:  # it is gone, or takes nothing: it may come again
            self._drop(reader)

    def _send(self, reader: _Reader, packet: bytes) -> bool:
        try:
            reader.socket.send(packet)
        except BlockingIOError:
            return False
        except OSError:
            self._drop(reader)
        return reader in self._readers

    def _release_read(self) -> None:
        """What readers have read is free."""
        for reader in list(self._readers):
            while True:
                try:
                    text = reader.socket.recv(_READ.size)
                except BlockingIOError:
                    break
                except OSError:
                    text = b""
                if len(text) != _READ.size:
                    self._drop(reader)
                    break
                (number,) = _READ.unpack(text)
                while reader.waiting and reader.waiting[0][0] <= number:
                    self._release(reader.waiting.popleft()[1])

    def _drop(self, reader: _Reader) -> None:
        self._readers.remove(reader)
        reader.socket.close()
        while reader.waiting:
            self._release(reader.waiting.popleft()[1])

    def _release(self, slot: int) -> None:
        if self._slots is not None:
            self._slots.release(slot)


class NearLink:
    """Reads a topic of another process.

    Args:
        loop: calls the callbacks.
        name: name of the other process's server.
        handle: called with each message.
        ended: called when the other end has closed the link, with the error, which may be empty.

    Raises:
        OSError: the other process is not on this computer, or belongs to another user.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, name: str, handle: Receive, ended: Callable[[str], None]
    ) -> None:
        self.late = 0
        """How many came while the loop was busy, and were dropped."""
        self._loop, self._take, self._ended = loop, handle, ended
        self._memory: SharedRegion | None = None
        self._socket = _socket()
        try:
            self._socket.connect(_address(name))
            if not _is_of_own_user(self._socket):
                raise PermissionError("it belongs to another user")
        except OSError:
            self._socket.close()
            raise
        self._is_open = True
        loop.add_reader(self._socket, self._read)

    def show(self, ticket: bytes) -> None:
        """Asks for the topic of a ticket."""
        with suppress(OSError):  # its end is read
            self._socket.send(ticket)

    def close(self) -> None:
        """Reads nothing any more."""
        if self._is_open:
            self._is_open = False
            self._loop.remove_reader(self._socket)
            self._socket.close()
            if self._memory is not None:
                self._memory.close()

    def _read(self) -> None:
        """Reads the available packets."""
        for _ in range(AHEAD):
            if not self._is_open:
                return
            try:
                packet, control, _, _ = self._socket.recvmsg(_LONGEST, _CONTROL)
            except BlockingIOError:
                return
            except OSError:
                packet, control = b"", []
            if not packet:
                self._end("")
                return
            try:
                self._work_off(packet, control)
            except (Gloc3Error, struct.error) as error:
                self._end(str(error))

    def _work_off(self, packet: bytes, control: list[tuple[int, int, bytes]]) -> None:
        """Takes a message out of the memory, and says that its place is free; or changes the memory."""
        number, slot, length = _PACKET.unpack_from(packet)
        if control:
            (file,) = _FILE.unpack(control[0][2])
            memory, self._memory = self._memory, SharedRegion(file, length)
            if memory is not None:
                memory.close()
        elif self._memory is not None:
            if self._memory.newest - number >= DEPTH:
                self.late += 1
            else:
                self._take(packet[_PACKET.size :], self._memory.read(slot, length))
            if self._is_open:
                with suppress(OSError):  # its end is read next
                    self._socket.send(_READ.pack(number))

    def _end(self, reason: str) -> None:
        self.close()
        self._ended(reason)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    made.setblocking(False)
    return made


def _address(name: str) -> bytes:
    """Address in Linux's abstract namespace: no file, and removed with the process."""
    return b"\0gloc3-" + name.encode()


def _is_of_own_user(other: socket.socket) -> bool:
    """Whether a process of the same user is, or was when it began to listen, at the other end."""
    _, user, _ = _CREDENTIALS.unpack(other.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return bool(user == os.geteuid())
