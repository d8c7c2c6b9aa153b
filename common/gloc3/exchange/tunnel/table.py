"""Table of numbers for channels (topic, type, source, frame) and tokens; rows are sent once and again on request."""

from __future__ import annotations

from itertools import islice
from typing import Any, Final

import msgspec

from gloc3.errors import UNREADABLE, Refused
from gloc3.exchange.tunnel.layout import SEALED_ROOM
from gloc3.exchange.tunnel.reader import TunnelFrameError
from gloc3.messages.envelope import Envelope, Source

MAX_ROWS: Final = 2048
"""Rows that one process may have; a peer's further ones are ignored."""

_Row = tuple[int, str, str, str, str, int, str]
"""Number, topic or token, type (empty for a token), platform, component, boot, frame."""
_ROWS_IN_FRAME: Final = 15
_DECODER: Final = msgspec.msgpack.Decoder(list[_Row])


class TunnelChannel(msgspec.Struct, frozen=True):
    """Common properties of all messages of one source on one topic; the source is None for a token."""

    topic: str
    type: str
    source: Source | None
    frame: str = ""


class OwnTable:
    """The numbers that this process uses, in the order in which they were needed."""

    def __init__(self) -> None:
        self._numbers: dict[TunnelChannel, int] = {}
        self._rows: list[bytes] = []

    def __len__(self) -> int:
        return len(self._rows)

    def channel(self, envelope: Envelope[Any]) -> int:
        """The number for an envelope's channel.

        Raises:
            Refused: its names are too long for a frame, or the table is full.
        """
        return self._number(TunnelChannel(envelope.topic, envelope.type, envelope.source, envelope.frame))

    def token(self, token: str) -> int:
        """The number for a token.

        Raises:
            Refused: it is too long for a frame, or the table is full.
        """
        return self._number(TunnelChannel(token, "", None))

    def rows(self, number: int) -> bytes:
        """One row, in the form that `PeerTable.add` takes."""
        return b"\x91" + self._rows[number]

    def frame_of(self, numbers: list[int]) -> tuple[bytes, int]:
        """Rows for one frame, from the front of `numbers`, and how many of them it took."""
        rows, size = [], 1
        for number in numbers[:_ROWS_IN_FRAME]:
            if size + len(self._rows[number]) > SEALED_ROOM:
                break
            rows.append(self._rows[number])
            size += len(rows[-1])
        return bytes((0x90 | len(rows),)) + b"".join(rows), len(rows)

    def _number(self, channel: TunnelChannel) -> int:
        number = self._numbers.get(channel)
        if number is not None:
            return number
        number = len(self._rows)
        source = channel.source or Source("", "", 0)
        topic = channel.topic
        if source.platform and topic.startswith(f"{source.platform}/"):
            topic = topic[len(source.platform) :]  # a topic never begins with a slash, so this can be undone
        row = msgspec.msgpack.encode(
            (number, topic, channel.type, source.platform, source.component, source.boot, channel.frame)
        )
        if len(row) + 1 > SEALED_ROOM:
            raise Refused(f"the names of {channel.topic} are too long for a frame of {SEALED_ROOM} bytes")
        if number >= MAX_ROWS:
            raise Refused(f"the table of topics is full ({MAX_ROWS} rows)")
        self._numbers[channel] = number
        self._rows.append(row)
        return number


class PeerTable:
    """Meanings of a peer's numbers, as far as they have been received."""

    def __init__(self) -> None:
        self._channels: dict[int, TunnelChannel] = {}
        self._size = 0

    def announce(self, size: int) -> None:
        """The peer says how many rows it has."""
        self._size = max(self._size, min(size, MAX_ROWS))

    def find(self, number: int) -> TunnelChannel | None:
        """Channel of a number; None where its row has to be requested."""
        found = self._channels.get(number)
        if found is None:
            self.announce(number + 1)
        return found

    def missing(self, limit: int) -> tuple[int, ...]:
        """Numbers whose rows have to be requested, at most `limit`."""
        if len(self._channels) >= self._size:
            return ()
        return tuple(islice((number for number in range(self._size) if number not in self._channels), limit))

    def add(self, rows: bytes) -> None:
        """Takes rows in.

        Raises:
            TunnelFrameError: they are damaged.
        """
        try:
            decoded = _DECODER.decode(rows)
        except UNREADABLE as error:
            raise TunnelFrameError(f"damaged table: {error}") from error
        for number, topic, type_text, platform, component, boot, frame in decoded:
            if not 0 <= number < MAX_ROWS:
                raise TunnelFrameError(f"row {number} is beyond the table")
            source = Source(platform, component, boot) if type_text else None
            full = platform + topic if topic.startswith("/") else topic
            self._channels.setdefault(number, TunnelChannel(full, type_text, source, frame))
            self._size = max(self._size, number + 1)
