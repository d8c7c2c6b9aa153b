"""Sink of a large file that is read: ordered pieces, so that it is never in memory as a whole."""

from __future__ import annotations

from typing import Final, Protocol

AHEAD_BYTES: Final = 256_000
"""What comes behind a hole is kept until the hole is filled; when it is more, the hole is asked for first.

So much is lost at most when a download is cut off, which goes on at its first hole."""


class Sink(Protocol):
    """Receiver of a file's content."""

    def opened(self, size: int) -> int:
        """The file is there; gives how many of its bytes, from the beginning on, are here already.

        Args:
            size: of the whole file, in bytes.
        """

    def write(self, data: bytes) -> None:
        """The next bytes of it."""


class InOrder:
    """Gives pieces on in their order.

    Args:
        sink: takes them.
        begin: where the first one belongs.
        ahead_bytes: how much is kept that has come too early.
    """

    def __init__(self, sink: Sink, begin: int, ahead_bytes: int = AHEAD_BYTES) -> None:
        self.given = begin
        """So much has been given on."""
        self._sink = sink
        self._most = ahead_bytes
        self._early: dict[int, bytes] = {}
        self._early_bytes = 0

    def put(self, offset: int, data: bytes) -> bool:
        """Takes a piece; False where there is no room for it before those are given on that come first."""
        if offset + len(data) <= self.given:
            return True
        if offset > self.given and self._early_bytes + len(data) > self._most:
            return False
        if len(self._early.get(offset, b"")) < len(data):
            self._early_bytes += len(data) - len(self._early.get(offset, b""))
            self._early[offset] = data
        return True

    def give(self, whole: int) -> None:
        """Gives on what has no holes any more.

        Args:
            whole: so much of the file has come without a hole.
        """
        if whole <= self.given:
            return
        for offset in sorted(offset for offset in self._early if offset < whole):
            data = self._early.pop(offset)
            self._early_bytes -= len(data)
            piece = data[self.given - offset :] if offset < self.given else data
            if piece:
                self._sink.write(piece)
                self.given += len(piece)
