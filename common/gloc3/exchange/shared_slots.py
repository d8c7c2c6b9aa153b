"""Places for large messages in memory that one process writes and others read.

The memory can neither be resized nor written by its readers, so that reading it is safe.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import struct
from typing import Final

from gloc3.errors import Gloc3Error

SLOTS: Final = 64
"""Places for messages; those that are free are used again first, so that few of them ever take real memory."""
SEAL_FUTURE_WRITE: Final = 0x10
"""Of linux/fcntl.h, which Python does not name: no other mapping may write."""
_COUNT: Final = struct.Struct("<Q")
"""The number of the last message, behind the places."""
SEALS: Final = fcntl.F_SEAL_SEAL | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | SEAL_FUTURE_WRITE


class Slots:
    """Places for messages of at most some length. What readers still hold is not written over.

    Args:
        slot_bytes: the longest message.

    Raises:
        OSError: the computer has no memory for it, or its Linux is older than 5.1.
    """

    def __init__(self, slot_bytes: int) -> None:
        self.slot_bytes: Final = -(-slot_bytes // mmap.PAGESIZE) * mmap.PAGESIZE
        size = _size(self.slot_bytes)
        self.file: Final = os.memfd_create("gloc3", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(self.file, size)
            self._memory = mmap.mmap(self.file, size)
            fcntl.fcntl(self.file, fcntl.F_ADD_SEALS, SEALS)
        except OSError:
            os.close(self.file)
            raise
        self._free = list(range(SLOTS))
        self._readers = [0] * SLOTS

    def write(self, data: bytes, number: int) -> int | None:
        """Copies a message into a free slot; None where readers hold all. The slot is free until a reader holds it."""
        if not self._free:
            return None
        slot = self._free[-1]
        begin = slot * self.slot_bytes
        self._memory[begin : begin + len(data)] = data
        _COUNT.pack_into(self._memory, SLOTS * self.slot_bytes, number)
        return slot

    def hold(self, slot: int) -> None:
        """One reader more is going to read a place."""
        if not self._readers[slot]:
            self._free.remove(slot)
        self._readers[slot] += 1

    def release(self, slot: int) -> None:
        """Releases a slot that one reader has read or abandoned."""
        self._readers[slot] -= 1
        if not self._readers[slot]:
            self._free.append(slot)

    def close(self) -> None:
        """Gives the memory back; readers that have it keep it until they do the same."""
        self._memory.close()
        os.close(self.file)


class SharedRegion:
    """Memory of another process, for reading its slots.

    Args:
        file: the memory's file descriptor, closed by this.
        slot_bytes: size of a slot, as reported by its creator.

    Raises:
        Gloc3Error: the memory is not as expected, so that reading it could crash this process.
    """

    def __init__(self, file: int, slot_bytes: int) -> None:
        self._slot_bytes = slot_bytes
        size = _size(slot_bytes)
        try:
            if fcntl.fcntl(file, fcntl.F_GET_SEALS) & SEALS != SEALS or os.fstat(file).st_size != size:
                raise Gloc3Error("the other end's shared memory could change its size")
            self._memory = mmap.mmap(file, size, prot=mmap.PROT_READ)
        except OSError as error:
            raise Gloc3Error(f"the other end's shared memory cannot be used: {error}") from error
        finally:
            os.close(file)

    @property
    def newest(self) -> int:
        """The number of the last message that was written."""
        (number,) = _COUNT.unpack_from(self._memory, SLOTS * self._slot_bytes)
        return int(number)

    def read(self, slot: int, length: int) -> bytes:
        """A copy of a message.

        Raises:
            Gloc3Error: there is no such place.
        """
        if slot >= SLOTS or length > self._slot_bytes:
            raise Gloc3Error(f"shared memory has no place {slot} of {length} bytes")
        begin = slot * self._slot_bytes
        return self._memory[begin : begin + length]

    def close(self) -> None:
        """Gives it back."""
        self._memory.close()


def _size(slot_bytes: int) -> int:
    return SLOTS * slot_bytes + mmap.PAGESIZE
