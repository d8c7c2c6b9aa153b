"""What the compiled loop of a direct line works on: tables that the rest of the process fills and reads meanwhile.

The loop (`gloc3.mavlink.services.compiled_line`) runs in the line's thread without Python's lock, and holds the line's own while it
deals with a datagram. Who changes where frames go takes that lock: once `revoke` is through, nothing leaves by what was
known before, so that a way may be closed.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from errno import EAGAIN
from functools import cache
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Table: TypeAlias = NDArray[Any]

State: Final = np.dtype(
    [
        ("descriptor", "i8"),
        ("flags", "i8"),
        ("is_wanted", "i8"),
        ("turn", "i8"),
        ("wires", "i8"),
        ("bytes_passed", "i8"),
        ("seed", "u8"),
    ]
)
"""Of a line: its socket and how it waits; whether somebody wants to know of what is passed on; the number of times that
old frames were forgotten; how many wires there are; what was passed on; what makes its hashes its own."""
Lane: Final = np.dtype(
    [("crc_extra", "i8"), ("wires", "i8"), ("last_at", "i8"), ("frames", "i8"), ("bytes", "i8"), ("lost", "i8")]
)
"""Frames of one kind: their message's byte of the checksum; the wires that they go to, as a set of bits; where the last
number of their sender is in memory; what was passed on, and what is missing."""
Slot: Final = np.dtype([("key", "i8"), ("row", "i8")])
"""System, component and message, to the row of their lane; the key is negative where nothing is."""
Wire: Final = np.dtype([("descriptor", "i8"), ("bytes", "i8"), ("dropped", "i8"), ("error", "i8")])
"""A way out: its socket, what went there, how often that failed, and why it did last."""
Note: Final = np.dtype([("mixed", "u8"), ("turn", "i8")])
"""A frame that has come: its hash, and when."""

LANES: Final = 1024
SLOTS: Final = 4 * LANES
MOST_WIRES: Final = 62
NOTES: Final = 1 << 15
MOST_FRAMES: Final = 128
"""In a datagram."""
SPREAD: Final = 0x9E3779B1
"""What keys are multiplied with."""
_NOBODY: Final = -1
_FIRST_TURN: Final = 2
"""What was never written, in turn 0, is long forgotten."""
_MUTEX_WORDS: Final = 8
"""64 bytes, which is more than any pthread_mutex_t of Linux has; all zeros it is an open one."""


class Outgoing(NamedTuple):
    """A way out of this process."""

    descriptor: int
    """A connected socket."""
    sent: Callable[[int, int, str], None]
    """Told now and then how many bytes went there, how often that failed, and why it did last."""


class Loop(Protocol):
    """What is compiled."""

    def serve(self, *tables: Table) -> int:
        """Passes on until something comes for somebody else."""

    def holds(self, *tables: Table) -> bool:
        """Whether a frame has been passed on lately."""


class FastLine:
    """The tables of one line. All but `serve` is called from the event loop's thread.

    Args:
        loop: what is compiled.
        descriptor: the socket that it receives from.
        order: two numbers of 64 bits: how many datagrams were left to the event loop, and how many it has dealt with.
        is_wanted: whether somebody wants to know of each datagram that is passed on.
        seed: 64 random bits.
        flags: of recv(2).
    """

    def __init__(
        self, loop: Loop, descriptor: int, order: memoryview, *, is_wanted: bool, seed: int, flags: int = 0
    ) -> None:
        self._loop = loop
        self._mutex: Table = np.zeros(_MUTEX_WORDS, np.int64)
        self._order: Table = np.frombuffer(order, np.int64)
        self._state: Table = np.zeros(1, State)
        self._slots: Table = np.zeros(SLOTS, Slot)
        self._lanes: Table = np.zeros(LANES, Lane)
        self._wires: Table = np.zeros(MOST_WIRES, Wire)
        self._notes: Table = np.zeros(NOTES, Note)
        self._slots["key"] = _NOBODY
        for name, value in (("descriptor", descriptor), ("flags", flags), ("is_wanted", is_wanted), ("seed", seed)):
            self._state[name] = value
        self._state["turn"] = _FIRST_TURN
        self._library, self._mutex_at = _library(), ctypes.c_void_p(self._mutex.ctypes.data)
        self._rows: dict[bytes, int] = {}
        self._last: dict[bytes, object] = {}
        """Keeps alive what the loop writes to."""
        self._free = list(range(LANES))
        self._entered: set[bytes] = set()
        """Kinds that are passed on."""
        self._used = 0
        """Slots that something is, or was, in."""
        self._outgoing: list[Outgoing] = []

    @property
    def bytes_passed(self) -> int:
        """What it has passed on."""
        return int(self._state["bytes_passed"][0])

    def serve(self, room: bytearray) -> int:
        """Passes on what comes until something comes for somebody else, in the line's thread.

        Args:
            room: where datagrams are received.

        Returns:
            The size of the datagram that is there; negative if it has been passed on; 0 if there is none.
        """
        buffer = np.frombuffer(room, np.uint8)
        return self._loop.serve(
            *(self._mutex, self._order, self._state, self._slots, self._lanes, self._wires, self._notes, buffer)
        )

    def holds(self, frame: bytes) -> bool:
        """Whether it has passed on this very frame lately."""
        return self._loop.holds(self._mutex, self._state, self._notes, np.frombuffer(frame, np.uint8))

    def put(self, key: bytes, crc_extra: int, last: bytearray, outgoing: Sequence[Outgoing]) -> bool:
        """Passes frames of one kind on from now on; False where there is no room.

        Args:
            key: system, component and message, as they are in the header.
            crc_extra: the message's byte of the checksum.
            last: one byte, the last number of the sender.
            outgoing: where they go.
        """
        with self._held():
            wires = 0
            for way in outgoing:
                if way not in self._outgoing:
                    if len(self._outgoing) == MOST_WIRES:
                        return False
                    self._wires[len(self._outgoing)] = (way.descriptor, 0, 0, 0)
                    self._outgoing.append(way)
                wires |= 1 << self._outgoing.index(way)
            self._state["wires"] = len(self._outgoing)
            if key not in self._rows:
                if not self._free:
                    return False
                self._rows[key] = self._free.pop()
            row = self._rows[key]
            byte = ctypes.c_ubyte.from_buffer(last)
            self._last[key] = byte
            lane = self._lanes[row : row + 1]
            lane["crc_extra"], lane["wires"], lane["last_at"] = crc_extra, wires, ctypes.addressof(byte)
            self._enter(key, row)
        return True

    def take(self, key: bytes) -> tuple[int, int, int]:
        """Of one kind, frames and bytes that were passed on since this was asked last, and frames that are missing."""
        row = self._rows.get(key)
        if row is None:
            return (0, 0, 0)
        with self._held():
            lane = self._lanes[row]
            taken = (int(lane["frames"]), int(lane["bytes"]), int(lane["lost"]))
            lane["frames"] = lane["bytes"] = lane["lost"] = 0
        return taken

    def end(self, key: bytes) -> tuple[int, int, int]:
        """Gives frames of one kind back from now on; the same of them."""
        if key not in self._rows:
            return (0, 0, 0)
        with self._held():
            if key in self._entered:
                self._entered.remove(key)
                self._slots["row"][self._place(_number(key))] = _NOBODY
        taken = self.take(key)
        del self._last[key]
        self._free.append(self._rows.pop(key))
        return taken

    def revoke(self) -> None:
        """Gives everything back from now on; when this returns nothing leaves any more by what was known."""
        with self._held():
            self._clear()
        self.settle()
        self._outgoing.clear()

    def settle(self) -> None:
        """Tells who owns the ways out what went there."""
        if not self._outgoing:
            return
        with self._held():
            taken = self._wires[: len(self._outgoing)].tolist()
            for name in ("bytes", "dropped", "error"):
                self._wires[name] = 0
        for way, (_, size, dropped, error) in zip(self._outgoing, taken, strict=True):
            if size or dropped:
                why = str(OSError(error, os.strerror(error))) if dropped and error != EAGAIN else ""
                way.sent(size, dropped, why)

    def forget(self) -> None:
        """Time has gone on: what has come before the last time is forgotten."""
        with self._held():
            self._state["turn"] += 1

    @contextmanager
    def _held(self) -> Iterator[None]:
        """While the loop deals with no datagram."""
        self._library.pthread_mutex_lock(self._mutex_at)
        try:
            yield
        finally:
            self._library.pthread_mutex_unlock(self._mutex_at)

    def _clear(self) -> None:
        if self._used:
            self._slots["key"] = _NOBODY
            self._used = 0
        self._entered.clear()

    def _enter(self, key: bytes, row: int) -> None:
        if self._used > SLOTS // 2:
            others = self._entered - {key}
            self._clear()
            for other in others:
                self._enter(other, self._rows[other])
        number = _number(key)
        place = self._place(number)
        self._used += int(self._slots["key"][place] == _NOBODY)
        self._slots[place] = (number, row)
        self._entered.add(key)

    def _place(self, number: int) -> int:
        """Where a key is, or may be put."""
        place = number * SPREAD >> 16 & SLOTS - 1
        keys = self._slots["key"]
        while keys[place] not in (number, _NOBODY):
            place = place + 1 & SLOTS - 1
        return place


@cache
def _library() -> ctypes.CDLL:
    """The process's own C library."""
    return ctypes.CDLL(None)


def _number(key: bytes) -> int:
    return int.from_bytes(key, "big")
