"""Sink of a large file that is read: ordered pieces, so that it is never in memory as a whole."""

from __future__ import annotations

from typing import Final, Protocol

AHEAD_BYTES: Final = 256_000
"""Data received beyond a gap and kept until the gap is filled, bytes; with more, the gap is requested first.

Also the most that is lost when a download is interrupted, since it resumes at its first gap."""


class Sink(Protocol):
    """Receiver of a file's content."""

    def opened(self, size: int) -> int:
        """The file exists; returns how many of its bytes, from the start, are already stored here.

        Args:
            size: of the whole file, in bytes.
        """

    def write(self, data: bytes) -> None:
        """The next bytes of it."""


class InOrder:
    """Writes pieces to a sink in order.

    Args:
        sink: receives them.
        begin: offset of the first piece.
        ahead_bytes: most bytes kept of pieces ahead of a gap.
    """

    def __init__(self, sink: Sink, begin: int, ahead_bytes: int = AHEAD_BYTES) -> None:
        self.given = begin
        """Offset up to which data has been written to the sink."""
        self._sink = sink
        self._most = ahead_bytes
        self._early: dict[int, bytes] = {}
        self._early_bytes = 0

    def put(self, offset: int, data: bytes) -> bool:
        """Stores a piece; False where there is no room for it until earlier pieces have been written."""
        if offset + len(data) <= self.given:
            return True
        if offset > self.given and self._early_bytes + len(data) > self._most:
            return False
        if len(self._early.get(offset, b"")) < len(data):
            self._early_bytes += len(data) - len(self._early.get(offset, b""))
            self._early[offset] = data
        return True

    def give(self, whole: int) -> None:
        """Writes the pieces that are free of gaps to the sink.

        Args:
            whole: bytes of the file received without a gap.
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
