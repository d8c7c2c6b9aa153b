"""Out of memory: what the process still needs then is reserved, the failure is reported once, and what held memory is freed."""

import errno
import mmap
import resource
from pathlib import Path
from typing import Final

RESERVE_BYTES: Final = 64 << 20
"""Address space that is kept free for threads and disk writers, bytes. It is never touched, and takes no memory."""
STATM: Final = Path("/proc/self/statm")
OUT_OF_MEMORY: Final = "out of memory"
NO_THREAD: Final = "can't start new thread"


def is_out_of_memory(error: BaseException | None) -> bool:
    """Whether an error means that memory, or address space for another thread, is used up."""
    return (
        isinstance(error, MemoryError)
        or (isinstance(error, OSError) and error.errno == errno.ENOMEM)
        or (isinstance(error, RuntimeError) and NO_THREAD in str(error))
    )


class MemoryReserve:
    """Address space of one process that is given back at the first failure, so that the rest can act on it."""

    def __init__(self) -> None:
        self._reserve: mmap.mmap | None = mmap.mmap(-1, RESERVE_BYTES)
        self.is_used = False
        """Whether memory has been used up since the start."""

    def release(self) -> bool:
        """Gives the reserve back; returns whether this is the first failure."""
        is_first, self.is_used = not self.is_used, True
        if self._reserve is not None:
            self._reserve.close()
            self._reserve = None
        return is_first

    @staticmethod
    def text() -> str:
        """The size of the process and its limit, as far as they are known."""
        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        limited = "" if limit == resource.RLIM_INFINITY else f" of at most {limit >> 20} MiB"
        try:
            pages = int(STATM.read_text().split()[0])
        except (OSError, ValueError, IndexError):
            return f"{OUT_OF_MEMORY}{limited}"
        return f"{OUT_OF_MEMORY}: the process has {pages * mmap.PAGESIZE >> 20} MiB{limited}"
