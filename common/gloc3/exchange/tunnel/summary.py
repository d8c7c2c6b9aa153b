"""Packs the components' summary: about five bytes a component, each frame complete in itself.

A frame holds one run of neighbouring indices, so that a component costs its values alone: health and the `ROW_FIELDS`, a
byte or one to three bytes each: never more than 9 bytes. The columns of a summary go before its rows, as an ordinary
message of the same sequence: a peer that does not know a field reads the rows all the same.
"""

from __future__ import annotations

import struct
from typing import Any, Final

from msgspec.structs import astuple, replace

from gloc3.exchange.tunnel.layout import ROOM
from gloc3.exchange.tunnel.reader import FrameError, Reader, varint
from gloc3.messages.envelope import Envelope
from gloc3.messages.status_fields import BYTE, ROW_FIELDS
from gloc3.messages.summaries import ComponentLine, Health, Summary

_T_S: Final = struct.Struct("<d")
_HEALTH: Final = tuple(Health)


class SummaryPacker:
    """The newest row of each component, and which of them are still to be sent, in turn."""

    def __init__(self) -> None:
        self._latest: Envelope[Any] | None = None
        self._rows: dict[int, ComponentLine] = {}
        self._waiting: list[int] = []
        self._is_told = True

    def offer(self, envelope: Envelope[Any]) -> int:
        """Takes a summary; rows of an earlier one that were not sent yet are replaced. Tells how many."""
        summary: Summary = envelope.payload
        if self._latest is not None and self._latest.payload.table != summary.table:
            self._rows.clear()
            self._waiting.clear()
        self._latest = envelope
        self._is_told = False
        waiting = set(self._waiting)
        replaced = 0
        for line in summary.lines:
            self._rows[line.index] = line
            if line.index in waiting:
                replaced += 1
            else:
                self._waiting.append(line.index)
        return replaced

    @property
    def is_waiting(self) -> bool:
        """Whether a frame is to be sent."""
        return bool(self._waiting) or not self._is_told

    def next_body(self, room: int) -> tuple[int, bytes]:
        """Sequence and body of the next frame; `room` are the bytes behind header, channel and sequence."""
        envelope = self._latest
        assert envelope is not None
        summary: Summary = envelope.payload
        first = self._waiting[0] if self._waiting else 0
        body = _T_S.pack(envelope.t_s) + varint(summary.table)
        body += bytes((_HEALTH.index(summary.health),)) + varint(first)
        taken = 0
        for index in self._waiting:
            row = _pack(self._rows[index])
            if index != first + taken or len(body) + len(row) > room:
                break
            body += row
            taken += 1
        del self._waiting[:taken]
        self._is_told = True
        return envelope.sequence, body


def columns_of(envelope: Envelope[Any]) -> Envelope[Any] | None:
    """The columns of a summary as a message of their own; None where there are none."""
    summary: Summary = envelope.payload
    return replace(envelope, payload=replace(summary, lines=[])) if summary.columns else None


def unpack(body: bytes) -> tuple[float, Summary]:
    """Time of validity and the rows of one frame.

    Raises:
        FrameError: the bytes are damaged.
    """
    reader = Reader(body)
    t_s, table, health, index = reader.time(), reader.varint(), reader.byte(), reader.varint()
    if health >= len(_HEALTH):
        raise FrameError(f"unknown health {health}")
    lines = []
    while not reader.is_at_end:
        state = reader.byte()
        values = [reader.byte() if field.most <= BYTE else reader.varint() for field in ROW_FIELDS]
        lines.append(ComponentLine(index, state, *values))
        index += 1
    return t_s, Summary(table=table, health=_HEALTH[health], lines=lines)


def room(channel: int, sequence: int) -> int:
    """Bytes for the body of a frame."""
    return ROOM - len(varint(channel)) - len(varint(sequence))


def _pack(line: ComponentLine) -> bytes:
    _, state, *values = astuple(line)
    packed = bytes((min(BYTE, max(0, state)),))
    for field, value in zip(ROW_FIELDS, values, strict=True):
        packed += bytes((min(BYTE, max(0, value)),)) if field.most <= BYTE else varint(max(0, value) & field.most)
    return packed
