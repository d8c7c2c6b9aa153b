"""Best effort: the latest message of each channel, split into frames by the sender, reassembled by the receiver.

A message of three or more parts is followed by a parity part, so that any one part may be lost: at 20 % loss, five
parts arrive in 66 instead of 33 of 100 cases.

The components' summary is packed: a frame holds one run of neighbouring indices, so that a component needs only the
bytes of its values: health and the `ROW_FIELDS`, one byte, or one to three bytes each, and never more than 9 bytes. The
columns of a summary are sent before its rows, as an ordinary message of the same sequence. A peer that does not know a
field can still read the rows.
"""

from __future__ import annotations

import struct
from collections import deque
from typing import Any, Final

from msgspec.structs import astuple, replace

from gloc3.exchange.tunnel.body import pack_status
from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import Status, StatusPart, SummaryRows
from gloc3.exchange.tunnel.layout import ROOM
from gloc3.exchange.tunnel.reader import ByteReader, TunnelFrameError, varint
from gloc3.messages.envelope import Envelope
from gloc3.messages.motion import MotionSummary
from gloc3.messages.status_fields import BYTE, ROW_FIELDS
from gloc3.messages.summaries import ComponentLine, Health, Summary

StatusFrame = Status | StatusPart | SummaryRows

MAX_PARTS: Final = 12
MIN_PARTS_WITH_PARITY: Final = 3
_PART_OVERHEAD: Final = 4
MAX_RUNS: Final = 64
"""Frames of one summary that are remembered."""
MAX_OPEN: Final = 256
"""Channels of one peer whose latest sequence is remembered."""

_T_S: Final = struct.Struct("<d")
_HEALTH: Final = tuple(Health)


class SummaryPacker:
    """The newest row of each component, and which of them are still to be sent, in turn."""

    def __init__(self) -> None:
        self._latest: Envelope[Any] | None = None
        self._rows: dict[int, ComponentLine] = {}
        self._waiting: list[int] = []
        self._is_reported = True

    def offer(self, envelope: Envelope[Any]) -> int:
        """Takes a summary; rows of an earlier one that were not sent yet are replaced. Tells how many."""
        summary: Summary = envelope.payload
        if self._latest is not None and self._latest.payload.table != summary.table:
            self._rows.clear()
            self._waiting.clear()
        self._latest = envelope
        self._is_reported = False
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
        return bool(self._waiting) or not self._is_reported

    def next_body(self, room: int) -> tuple[int, bytes]:
        """Sequence and body of the next frame; `room` are the bytes behind header, channel and sequence."""
        envelope = self._latest
        assert envelope is not None
        summary: Summary = envelope.payload
        first = self._waiting[0] if self._waiting else 0
        body = _T_S.pack(envelope.t_s) + varint(summary.table)
        body += bytes((_HEALTH.index(summary.health),)) + varint(first)
        used = 0
        for index in self._waiting:
            row = _packed(self._rows[index])
            if index != first + used or len(body) + len(row) > room:
                break
            body += row
            used += 1
        del self._waiting[:used]
        self._is_reported = True
        return envelope.sequence, body


def columns_of(envelope: Envelope[Any]) -> Envelope[Any] | None:
    """The columns of a summary as a message of their own; None where there are none."""
    summary: Summary = envelope.payload
    return replace(envelope, payload=replace(summary, lines=[])) if summary.columns else None


def unpack_summary(body: bytes) -> tuple[float, Summary]:
    """Time of validity and the rows of one frame.

    Raises:
        TunnelFrameError: the bytes are damaged.
    """
    reader = ByteReader(body)
    t_s, table, health, index = reader.time(), reader.varint(), reader.byte(), reader.varint()
    if health >= len(_HEALTH):
        raise TunnelFrameError(f"unknown health {health}")
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


def _packed(line: ComponentLine) -> bytes:
    _, state, *values = astuple(line)
    packed = bytes((min(BYTE, max(0, state)),))
    for field, value in zip(ROW_FIELDS, values, strict=True):
        packed += bytes((min(BYTE, max(0, value)),)) if field.most <= BYTE else varint(max(0, value) & field.most)
    return packed


class _Slot:
    """One channel: the message that is being sent, and the newest that waits behind it."""

    __slots__ = ("latest", "parts")

    def __init__(self) -> None:
        self.latest: Envelope[Any] | None = None
        self.parts: deque[StatusFrame] = deque()


class StatusSender:
    """What is to be sent, one frame at a time: every second one is the summary's, the others take turns.

    The motion, which comes most often and is missed least, has what these leave.
    """

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._slots: dict[int, _Slot] = {}
        self._turns: deque[int] = deque()
        self._last: deque[int] = deque()
        """Channels that are sent only when no other is waiting."""
        self._summaries: dict[int, SummaryPacker] = {}
        self._columns: dict[int, deque[StatusFrame]] = {}
        """Frames that go before the rows of a summary."""
        self._was_summary = False

    def offer(self, channel: int, envelope: Envelope[Any]) -> None:
        """Queues a message; an earlier one of its channel that has not begun to be sent is dropped."""
        if isinstance(envelope.payload, Summary):
            self._counters.replaced += self._summaries.setdefault(channel, SummaryPacker()).offer(envelope)
            columns = columns_of(envelope)
            self._columns[channel] = deque(self._cut(channel, columns) if columns is not None else ())
            return
        slot = self._slots.setdefault(channel, _Slot())
        if slot.latest is not None:
            self._counters.replaced += 1
        elif not slot.parts:
            (self._last if isinstance(envelope.payload, MotionSummary) else self._turns).append(channel)
        slot.latest = envelope

    @property
    def is_waiting(self) -> bool:
        """Whether a frame is to be sent."""
        return bool(self._turns or self._last) or any(packer.is_waiting for packer in self._summaries.values())

    def next_frame(self) -> StatusFrame | None:
        """The next frame; None where nothing waits."""
        if not (self._was_summary and self._turns):
            for channel, packer in self._summaries.items():
                if packer.is_waiting:
                    self._was_summary = True
                    if self._columns[channel]:
                        return self._columns[channel].popleft()
                    sequence, body = packer.next_body(room(channel, 1 << 28))
                    return SummaryRows(channel, sequence, body)
        self._was_summary = False
        while turns := self._turns or self._last:
            channel = turns.popleft()
            slot = self._slots[channel]
            if not slot.parts and slot.latest is not None:
                slot.parts.extend(self._cut(channel, slot.latest))
                slot.latest = None
            if slot.parts:
                frame = slot.parts.popleft()
                if slot.parts or slot.latest is not None:
                    turns.append(channel)
                return frame
        return None

    def _cut(self, channel: int, envelope: Envelope[Any]) -> list[StatusFrame]:
        body = pack_status(envelope)
        names = len(varint(channel)) + len(varint(envelope.sequence))
        if len(body) <= ROOM - names:
            return [Status(channel, envelope.sequence, body)]
        size = ROOM - names - _PART_OVERHEAD
        count = -(-len(body) // size)
        if count > MAX_PARTS:
            self._counters.too_long += 1
            return []
        size = -(-len(body) // count)
        chunks = [body[at : at + size] for at in range(0, len(body), size)]
        if count >= MIN_PARTS_WITH_PARITY:
            chunks.append(_parity(chunks))
        return [
            StatusPart(channel, envelope.sequence, index, count, len(body), chunk) for index, chunk in enumerate(chunks)
        ]


class _Arrival:
    """How far the latest message of a channel has come."""

    __slots__ = ("chunks", "count", "runs", "sequence", "size")

    def __init__(self, sequence: int, count: int, size: int) -> None:
        self.sequence = sequence
        self.count = count
        """Parts; 0 once the message is complete."""
        self.size = size
        self.chunks: dict[int, bytes] = {}
        self.runs: set[bytes] = set()
        """Frames of the summary with this sequence that have come."""


class StatusReceiver:
    """Reassembles one peer's messages; drops those older than the latest received."""

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._arrivals: dict[int, _Arrival] = {}

    def receive_whole(self, channel: int, sequence: int) -> bool:
        """Whether a message that fits one frame is new."""
        return self._open(channel, sequence, 0, 0) is not None

    def receive_rows(self, channel: int, sequence: int, body: bytes) -> bool:
        """Whether a frame of the summary is new; several may share a sequence."""
        last = self._arrivals.get(channel)
        if last is None or last.sequence != sequence:
            last = self._open(channel, sequence, 0, 0)
            if last is None:
                return False
        if body in last.runs or len(last.runs) >= MAX_RUNS:
            self._counters.late += 1
            return False
        last.runs.add(body)
        return True

    def receive_part(self, part: StatusPart) -> bytes | None:
        """The whole body, once enough parts are here.

        Raises:
            TunnelFrameError: the part contradicts itself or the others.
        """
        has_parity = part.count >= MIN_PARTS_WITH_PARITY
        if not 2 <= part.count <= MAX_PARTS or part.index >= part.count + has_parity or not part.chunk:
            raise TunnelFrameError("a part has no place in its message")
        last = self._arrivals.get(part.channel)
        if last is None or last.sequence != part.sequence:
            last = self._open(part.channel, part.sequence, part.count, part.size)
            if last is None:
                return None
        elif not last.count or part.index in last.chunks:
            self._counters.late += 1
            return None
        if (part.count, part.size) != (last.count, last.size):
            raise TunnelFrameError("the parts of a message do not fit together")
        last.chunks[part.index] = part.chunk
        if len(last.chunks) < last.count:
            return None
        body = _join(last.chunks, last.count, last.size)
        last.count = 0
        last.chunks.clear()
        return body

    def _open(self, channel: int, sequence: int, count: int, size: int) -> _Arrival | None:
        last = self._arrivals.get(channel)
        if last is not None:
            if sequence <= last.sequence:
                self._counters.late += 1
                return None
            if last.count:
                self._counters.incomplete += 1
        elif len(self._arrivals) >= MAX_OPEN:
            del self._arrivals[next(iter(self._arrivals))]
        arrival = self._arrivals[channel] = _Arrival(sequence, count, size)
        return arrival


def _join(chunks: dict[int, bytes], count: int, size: int) -> bytes:
    missing = next((index for index in range(count) if index not in chunks), None)
    if missing is not None:
        chunks[missing] = _parity([chunk for _, chunk in sorted(chunks.items())])
    body = b"".join(chunks[index] for index in range(count))[:size]
    if len(body) != size:
        raise TunnelFrameError("the parts of a message do not fit together")
    return body


def _parity(chunks: list[bytes]) -> bytes:
    width = max(len(chunk) for chunk in chunks)
    total = 0
    for chunk in chunks:
        total ^= int.from_bytes(chunk.ljust(width, b"\0"), "little")
    return total.to_bytes(width, "little")
