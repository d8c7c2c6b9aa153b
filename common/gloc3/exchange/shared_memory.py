"""Memory that processes of one host share: a large message is copied into it once, and out of it once."""

from threading import Thread
from typing import Final

import zenoh

LARGE: Final = 16_384
"""Messages of so many bytes go through shared memory."""
POOL: Final = 16 * 1024 * 1024
"""Bytes of it that a process takes when it has the first large message; that takes 0.1 s, so a thread does it."""


class SharedMemory:
    """The shared memory that one process writes. Zenoh copies on to receivers that cannot reach it."""

    def __init__(self) -> None:
        self._provider: zenoh.shm.ShmProvider | None = None
        self._maker: Thread | None = None

    def hold(self, data: bytes) -> bytes | zenoh.shm.ZShmMut | None:
        """A copy of some bytes in shared memory, or, while that is being made, these; None where receivers hold all."""
        if self._provider is None:
            if self._maker is None:
                self._maker = Thread(target=self._make, name="shared memory", daemon=True)
                self._maker.start()
            return data
        try:
            place = self._provider.alloc(len(data), policy=zenoh.shm.GarbageCollect())
        except zenoh.ZError:
            return None
        place[0 : len(data)] = data
        return place

    def _make(self) -> None:
        self._provider = zenoh.shm.ShmProvider.default_backend(POOL)
