"""Memory that processes of one host share: a large message is copied into it once, and out of it once."""

from typing import Final

import zenoh

LARGE: Final = 16_384
"""Messages of so many bytes go through shared memory."""
POOL: Final = 32 * 1024 * 1024
"""Bytes of it that a process takes, when it sends the first large message."""


class SharedMemory:
    """The shared memory that one process writes. Zenoh copies on to receivers that cannot reach it."""

    def __init__(self) -> None:
        self._provider: zenoh.shm.ShmProvider | None = None

    def hold(self, data: bytes) -> zenoh.shm.ZShmMut | None:
        """A copy of some bytes in shared memory; None while receivers still hold all of it."""
        if self._provider is None:
            self._provider = zenoh.shm.ShmProvider.default_backend(POOL)
        try:
            place = self._provider.alloc(len(data), policy=zenoh.shm.GarbageCollect())
        except zenoh.ZError:
            return None
        place[0 : len(data)] = data
        return place
