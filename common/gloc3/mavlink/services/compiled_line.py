"""The loop of a direct line, compiled: it receives, looks at header and checksum, and sends on, without Python's lock.

Only `gloc3.mavlink.services.compiling` imports this, where numba is installed; the tables are those of `gloc3.mavlink.services.fast_line`. What
this loop does is what `gloc3.mavlink.services.lanes` does, for frames whose way is known; all else it gives back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

import numba
import numpy as np

from gloc3.mavlink.gaps import MOST_GAP
from gloc3.mavlink.parser import MAGIC_2
from gloc3.mavlink.services.fast_line import MOST_FRAMES, NOTES, SLOTS, SPREAD, Lane, Note, Slot, State, Wire

F = TypeVar("F", bound=Callable[..., Any])

_numba: Final[Any] = numba
types: Final = _numba.types
_AROUND: Final = 12
"""Bytes of a MAVLink 2 frame around its payload."""
_AT_ONCE: Final = 0x40
"""MSG_DONTWAIT of Linux."""
_MONOTONIC: Final = 1
"""CLOCK_MONOTONIC of Linux."""
_FREE: Final = -1
_ENOUGH: Final = 8
"""So many places for a note are looked at."""
_PRIME: Final = np.uint64(0x100000001B3)
"""Of the hash by Fowler, Noll and Vo (FNV-1a, 64 bits)."""
_WINDOW: Final = 64
"""After so many datagrams it is asked anew how fast they come."""
_FAST_NS: Final = _WINDOW * 200_000
"""In less time than this they come fast: more than 5,000 a second…"""
_GATHER_US: Final = 200
"""…and so long they are left to gather, since each waking costs more than passing one on. (Network cards do so, too.)"""
_SLOT_MASK: Final = SLOTS - 1
_NOTE_MASK: Final = np.uint64(NOTES - 1)

_receive = types.ExternalFunction("recv", types.intp(types.intc, types.uintp, types.uintp, types.intc))
_send = types.ExternalFunction("send", types.intp(types.intc, types.uintp, types.uintp, types.intc))
_copy = types.ExternalFunction("memcpy", types.uintp(types.uintp, types.uintp, types.uintp))
_lock = types.ExternalFunction("pthread_mutex_lock", types.intc(types.uintp))
_unlock = types.ExternalFunction("pthread_mutex_unlock", types.intc(types.uintp))
_sleep_us = types.ExternalFunction("usleep", types.intc(types.uint32))
_read_clock = types.ExternalFunction("clock_gettime", types.intc(types.intc, types.uintp))
_error = types.ExternalFunction("__errno_location", types.CPointer(types.intc)())
"""Functions of the C library: they are found in the process itself, so that what is compiled can be kept in a file."""


def _rows(dtype: Any) -> Any:
    """The type of a table, for the compiler."""
    return types.Array(_numba.from_dtype(dtype), 1, "C")


def _compiled(*arguments: Any) -> Callable[[F], F]:
    """Compiles a function when this module is loaded, or takes what was kept of the last time."""
    compile_: Callable[[F], F] = _numba.njit(arguments or None, nogil=True, cache=True, error_model="numpy")
    return compile_


@_compiled()
def _sums(buffer: Any, begin: int, end: int, crc_extra: int, seed: Any) -> tuple[int, Any]:
    """The checksum of a frame (CRC-16/MCRF4XX over all but its magic byte, and the message's own byte), and a hash."""
    crc, mixed = 0xFFFF, seed
    for at in range(begin + 1, end - 2):
        byte = buffer[at]
        mixed = (mixed ^ np.uint64(byte)) * _PRIME
        low = (byte ^ crc) & 0xFF
        low = (low ^ low << 4) & 0xFF
        crc = (crc >> 8 ^ low << 8 ^ low << 3 ^ low >> 4) & 0xFFFF
    low = (crc_extra ^ crc) & 0xFF
    low = (low ^ low << 4) & 0xFF
    return (crc >> 8 ^ low << 8 ^ low << 3 ^ low >> 4) & 0xFFFF, mixed


@_compiled()
def _lane_of(slots: Any, buffer: Any, at: int) -> int:
    """The row of the lane of a frame, by its system, component and message; negative for none."""
    key = 0
    for index in range(5):
        key = key << 8 | buffer[at + 5 + index]
    place = key * SPREAD >> 16 & _SLOT_MASK
    while slots[place].key != _FREE:
        if slots[place].key == key:
            return int(slots[place].row)
        place = place + 1 & _SLOT_MASK
    return -1


@_compiled()
def _note(notes: Any, mixed: Any, turn: int) -> None:
    """Remembers when a frame came first; where there is no room the oldest of some is forgotten."""
    place = mixed >> np.uint64(20) & _NOTE_MASK
    oldest = place
    for _ in range(_ENOUGH):
        if notes[place].mixed == mixed and notes[place].turn >= turn - 1:
            return
        if notes[place].turn < notes[oldest].turn:
            oldest = place
        place = place + np.uint64(1) & _NOTE_MASK
    notes[oldest].mixed, notes[oldest].turn = mixed, turn


@_compiled()
def _whole(state: Any, slots: Any, lanes: Any, buffer: Any, size: int, rows: Any, hashes: Any) -> int:
    """How many frames a datagram holds, if all are plain, right, and go the same way; else 0. Fills in rows and hashes."""
    at = count = 0
    while at < size:
        if count == MOST_FRAMES or at + _AROUND > size or buffer[at] != MAGIC_2 or buffer[at + 2]:
            return 0
        end = at + buffer[at + 1] + _AROUND
        if end > size:
            return 0
        row = _lane_of(slots, buffer, at)
        if row < 0 or lanes[row].wires != lanes[rows[0] if count else row].wires:
            return 0
        crc, mixed = _sums(buffer, at, end, lanes[row].crc_extra, state.seed)
        if crc != buffer[end - 2] | buffer[end - 1] << 8:
            return 0
        rows[count], hashes[count] = row, mixed
        at, count = end, count + 1
    return count


@_compiled()
def _send_all(state: Any, wires: Any, wanted: int, at: Any, size: int) -> None:
    """Sends a datagram on each of some wires, as a set of bits."""
    for index in range(state.wires):
        if wanted >> index & 1:
            wire = wires[index]
            sent = _send(wire.descriptor, at, size, _AT_ONCE)
            if sent < 0:  # it may tell of what was sent before
                sent = _send(wire.descriptor, at, size, _AT_ONCE)
            if sent < 0:
                wire.dropped += 1
                wire.error = _error()[0]
            else:
                wire.bytes += sent


@_compiled()
def _count(lanes: Any, rows: Any, buffer: Any, count: int, last: Any) -> None:
    """Counts what was passed on, and what is missing by the senders' numbers."""
    at = 0
    for index in range(count):
        lane, size = lanes[rows[index]], buffer[at + 1] + _AROUND
        _copy(last.ctypes.data, lane.last_at, 1)
        gap = (buffer[at + 4] - last[0] - 1) & 0xFF
        if gap < MOST_GAP:
            lane.lost += gap
        _copy(lane.last_at, buffer.ctypes.data + at + 4, 1)
        lane.frames += 1
        lane.bytes += size
        at += size


@_compiled()
def _now_ns(time: Any) -> int:
    """The monotonic clock; `time` is where the C library writes seconds and nanoseconds."""
    _read_clock(_MONOTONIC, time.ctypes.data)
    return int(time[0]) * 1_000_000_000 + int(time[1])


@_compiled(
    *(types.int64[::1], types.int64[::1], _rows(State), _rows(Slot), _rows(Lane), _rows(Wire), _rows(Note)),
    types.uint8[::1],
)
def serve(mutex: Any, order: Any, states: Any, slots: Any, lanes: Any, wires: Any, notes: Any, buffer: Any) -> int:
    """Passes on what comes, until something comes that it may not pass on, or that somebody else wants to know of.

    Args:
        mutex: held while a datagram is dealt with.
        order: how many datagrams were left to the loop, and how many of them it has dealt with.
        states: the line's one row.
        slots: which lane has which row.
        lanes: where frames of one kind go.
        wires: the ways out.
        notes: what has come lately.
        buffer: where datagrams are received.

    Returns:
        The size of the datagram that is in the buffer; negative if it has been passed on; 0 if there is none.
    """
    state, at, lock = states[0], buffer.ctypes.data, mutex.ctypes.data
    rows, hashes, last = np.empty(MOST_FRAMES, np.int64), np.empty(MOST_FRAMES, np.uint64), np.empty(1, np.uint8)
    time, received = np.empty(2, np.int64), 0
    since_ns, is_fast = _now_ns(time), False
    while True:
        size: int = _receive(state.descriptor, at, len(buffer), _AT_ONCE) if is_fast else -1
        if size < 0:
            if is_fast:
                _sleep_us(_GATHER_US)
            size = _receive(state.descriptor, at, len(buffer), state.flags)
        if size <= 0:
            return 0
        received += 1
        if received == _WINDOW:
            now_ns = _now_ns(time)
            is_fast, since_ns, received = now_ns - since_ns < _FAST_NS, now_ns, 0
        _lock(lock)
        count = 0
        if order[0] == order[1]:
            count = _whole(state, slots, lanes, buffer, size, rows, hashes)
        if count:
            for index in range(count):
                _note(notes, hashes[index], state.turn)
            _send_all(state, wires, lanes[rows[0]].wires, at, size)
            _count(lanes, rows, buffer, count, last)
            state.bytes_passed += size
        _unlock(lock)
        if not count:
            return size
        if state.is_wanted:
            return -size


@_compiled(types.int64[::1], _rows(State), _rows(Note), types.Array(types.uint8, 1, "C", readonly=True))
def holds(mutex: Any, states: Any, notes: Any, frame: Any) -> bool:
    """Whether a frame has been passed on lately."""
    _, mixed = _sums(frame, 0, len(frame), 0, states[0].seed)
    place = mixed >> np.uint64(20) & _NOTE_MASK
    found = False
    _lock(mutex.ctypes.data)
    for _ in range(_ENOUGH):
        if notes[place].mixed == mixed and notes[place].turn >= states[0].turn - 1:
            found = True
            break
        place = place + np.uint64(1) & _NOTE_MASK
    _unlock(mutex.ctypes.data)
    return found
