"""STATUSTEXT: texts for people, long ones split into chunks of 50 bytes and reassembled."""

from __future__ import annotations

from typing import Final, Never

import msgspec

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice

CHUNK_BYTES: Final = 50
LONGEST_BYTES: Final = 1000
WAIT_S: Final = 2.0
"""Time without another chunk after which an incomplete text is passed on with its gaps marked, s."""
MOST_UNFINISHED: Final = 32
GAP: Final = "[...]"


class StatusText(msgspec.Struct, frozen=True):
    """A whole text."""

    sender: Address
    severity: int
    """MAV_SEVERITY: 0 is an emergency, 6 information, 7 debugging."""
    text: str


class StatusTextSender(Microservice[Never]):
    """Sends texts of any length (up to a bound)."""

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self._id = 0

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Nothing: it only sends."""

    def send(self, severity: int, text: str) -> None:
        """Sends a text, cut off at 1,000 bytes.

        Args:
            severity: MAV_SEVERITY.
            text: for people, in any characters.
        """
        chunks = _cut(text)
        if len(chunks) == 1:
            self._send("STATUSTEXT", severity=severity, text=chunks[0])
            return
        self._id = self._id % 0xFFFF + 1
        if len(chunks[-1].encode()) == CHUNK_BYTES:
            chunks.append("")  # the end is told by a chunk that is not full
        for number, chunk in enumerate(chunks):
            self._send("STATUSTEXT", severity=severity, text=chunk, id_=self._id, chunk_seq=number)


class StatusTextReceiver(Microservice[StatusText]):
    """Puts texts together; each comes out as an event."""

    handles = frozenset({"STATUSTEXT"})

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self._unfinished: dict[tuple[Address, int], _Unfinished] = {}

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a text or a chunk of one."""
        if message.id_ == 0:
            self._events.append(StatusText(sender, message.severity, message.text))
            return
        key = (sender, message.id_)
        text = self._unfinished.get(key)
        if text is None:
            if len(self._unfinished) >= MOST_UNFINISHED:
                self._finish(next(iter(self._unfinished)))
            text = self._unfinished[key] = _Unfinished(message.severity)
        text.last_s = now_s
        text.chunks[message.chunk_seq] = message.text
        if len(message.text.encode()) < CHUNK_BYTES:
            text.count = message.chunk_seq + 1
        if text.count is not None and len(text.chunks) >= text.count:
            self._finish(key)

    def tick(self, now_s: float) -> None:
        """Passes on texts that have waited long enough for their missing chunks."""
        for key in [key for key, text in self._unfinished.items() if now_s >= text.last_s + WAIT_S]:
            self._finish(key)

    def next_tick_s(self) -> float | None:
        """When the first one has waited long enough."""
        return min((text.last_s + WAIT_S for text in self._unfinished.values()), default=None)

    def _finish(self, key: tuple[Address, int]) -> None:
        text = self._unfinished.pop(key)
        parts: list[str] = []
        expected = 0
        for number in sorted(text.chunks):
            if number != expected:
                parts.append(GAP)
            parts.append(text.chunks[number])
            expected = number + 1
        if text.count is None or expected < text.count:
            parts.append(GAP)
        self._events.append(StatusText(key[0], text.severity, "".join(parts)))


class _Unfinished:
    """The chunks of one text that have come so far."""

    __slots__ = ("chunks", "count", "last_s", "severity")

    def __init__(self, severity: int) -> None:
        self.severity = severity
        self.chunks: dict[int, str] = {}
        self.count: int | None = None
        self.last_s = 0.0


def _cut(text: str) -> list[str]:
    """Pieces of 50 bytes, the last one shorter; a character that would be split moves to the next piece."""
    chunks: list[str] = []
    piece, size, total = "", 0, 0
    for character in text:
        width = len(character.encode("utf-8", "replace"))
        total += width
        if total > LONGEST_BYTES:
            break
        if size + width > CHUNK_BYTES:
            chunks.append(piece + " " * (CHUNK_BYTES - size))
            piece, size = "", 0
        piece += character
        size += width
    return [*chunks, piece]
