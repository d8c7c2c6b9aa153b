"""The receiver of reliable messages from one life of one peer: reassembles them and delivers each once, in order.

A message counts as done, and is acknowledged as such, when the layer above has it; while one cannot be handed over
yet, it stays here, complete, and those behind it wait. A message that is refused is done when its sender has dropped
it: the base in later frames says so.
"""

from __future__ import annotations

from typing import Final

from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import CHUNK, Ack, Data, LaneReport, Refusal
from gloc3.exchange.tunnel.layout import Lane
from gloc3.exchange.tunnel.reader import unwrap
from gloc3.exchange.tunnel.sending import MAX_FRAGMENTS, WINDOW

MAX_BUFFERED: Final = 160 * 1024
"""Bytes that one peer's open messages may take."""
ACK_AFTER_FRAMES: Final = 8
ACK_AFTER_S: Final = 0.2
ACK_SPACING_S: Final = 0.04
RECENT_S: Final = 3.0


class _Message:
    """A message as far as it is here."""

    __slots__ = ("chunks", "count", "mask")

    def __init__(self, count: int) -> None:
        self.count = count
        self.mask = 0
        self.chunks: list[bytes] = [b""] * count

    @property
    def is_complete(self) -> bool:
        return self.mask == (1 << self.count) - 1


class _Inbox:
    """One lane."""

    __slots__ = ("expected", "messages", "reason")

    def __init__(self) -> None:
        self.expected: int | None = None
        """The message that is handed over next; None before the first frame."""
        self.messages: dict[int, _Message] = {}
        self.reason = ""
        """Why the next message was refused, until its sender has been informed."""


class ReliableReceiver:
    """Everything reliable that comes from one life of one peer."""

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._lanes = {lane: _Inbox() for lane in Lane}
        self._buffered_fragments = 0
        self._highest = -1
        self._highest_s = 0.0
        self._received = 0
        self._unacknowledged = 0
        self._ack_s: float | None = None
        self._acked_s = -1.0
        self._refusals: list[tuple[Lane, int]] = []
        self._bulk_s = -RECENT_S

    def is_receiving_bulk(self, now_s: float) -> bool:
        """Whether a large message has been coming in of late."""
        return bool(self._lanes[Lane.BULK].messages) and now_s - self._bulk_s < RECENT_S

    def receive(self, data: Data, now_s: float) -> None:
        """Takes a fragment in."""
        self._note(data, now_s)
        inbox = self._lanes[data.lane]
        if inbox.expected is None:
            inbox.expected = max(0, data.number - data.base_delta)
        number = unwrap(data.number, inbox.expected)
        self._skip(inbox, number - data.base_delta)
        if number < inbox.expected:
            self._counters.duplicates += 1
            self._hurry(now_s)
            return
        if number == inbox.expected and inbox.reason:
            if (data.lane, number) not in self._refusals:
                self._refusals.append((data.lane, number))
            return
        if number >= inbox.expected + 2 * WINDOW[data.lane] or not self._place(inbox, number, data):
            self._counters.beyond_window += 1
            return
        if data.lane is Lane.BULK:
            self._bulk_s = now_s
        if inbox.messages[number].is_complete:
            self._hurry(now_s)

    def _place(self, inbox: _Inbox, number: int, data: Data) -> bool:
        """Puts a fragment where it belongs; False where that is nowhere."""
        if not data.index < data.count <= MAX_FRAGMENTS:
            return False
        message = inbox.messages.get(number)
        if message is None:
            if (self._buffered_fragments + data.count) * CHUNK > MAX_BUFFERED:
                return False
            message = inbox.messages[number] = _Message(data.count)
            self._buffered_fragments += data.count
        if data.count != message.count or (len(data.chunk) != CHUNK and data.index != data.count - 1):
            return False
        if message.mask >> data.index & 1:
            self._counters.duplicates += 1
        else:
            message.mask |= 1 << data.index
            message.chunks[data.index] = data.chunk
        return True

    # --- handing over ---

    def head(self, lane: Lane) -> bytes | None:
        """The whole body of the message that is next, if it is complete."""
        inbox = self._lanes[lane]
        if inbox.expected is None or inbox.reason:
            return None
        message = inbox.messages.get(inbox.expected)
        return b"".join(message.chunks) if message is not None and message.is_complete else None

    def done(self, lane: Lane) -> None:
        """The message that was next has been handed over."""
        inbox = self._lanes[lane]
        assert inbox.expected is not None
        self._skip(inbox, inbox.expected + 1)

    def refuse(self, lane: Lane, reason: str) -> None:
        """The message that is next will never be handed over."""
        inbox = self._lanes[lane]
        assert inbox.expected is not None
        self._drop(inbox, inbox.expected)
        inbox.reason = reason or "no reason was given"
        self._refusals.append((lane, inbox.expected))

    def drop_incomplete(self) -> None:
        """Frees the memory of everything that has not been handed over."""
        for inbox in self._lanes.values():
            for number in list(inbox.messages):
                self._drop(inbox, number)

    def _skip(self, inbox: _Inbox, base: int) -> None:
        """What is older than `base` will not come any more."""
        if inbox.expected is None or base <= inbox.expected:
            return
        for number in [number for number in inbox.messages if number < base]:
            self._drop(inbox, number)
        inbox.expected = base
        inbox.reason = ""

    def _drop(self, inbox: _Inbox, number: int) -> None:
        message = inbox.messages.pop(number, None)
        if message is not None:
            self._buffered_fragments -= message.count

    # --- answering ---

    def next_refusal(self, to_boot: int) -> Refusal | None:
        """A refusal that is to be sent."""
        while self._refusals:
            lane, number = self._refusals.pop(0)
            inbox = self._lanes[lane]
            if number == inbox.expected and inbox.reason:
                return Refusal(to_boot & 0xFFFF, lane, number, inbox.reason)
        return None

    @property
    def has_refusal(self) -> bool:
        """Whether a refusal is to be sent."""
        return bool(self._refusals)

    def ack_s(self) -> float | None:
        """When an acknowledgement is to be sent; None where there is nothing new to acknowledge."""
        return None if self._ack_s is None else max(self._ack_s, self._acked_s + ACK_SPACING_S)

    def ack(self, to_boot: int, now_s: float) -> Ack:
        """What is here."""
        self._ack_s = None
        self._acked_s = now_s
        self._unacknowledged = 0
        reports = []
        for lane, inbox in self._lanes.items():
            if inbox.expected is not None:
                partial = tuple(
                    (number - inbox.expected, None if message.is_complete else message.mask)
                    for number, message in sorted(inbox.messages.items())
                )
                reports.append(LaneReport(lane, inbox.expected, partial))
        return Ack(to_boot & 0xFFFF, self._highest, self._received, now_s - self._highest_s, tuple(reports))

    def _note(self, data: Data, now_s: float) -> None:
        serial = unwrap(data.serial, max(self._highest, 0))
        if serial > self._highest:
            self._highest, self._highest_s = serial, now_s
        self._received += 1
        self._unacknowledged += 1
        if data.is_last or self._unacknowledged >= ACK_AFTER_FRAMES:
            self._hurry(now_s)
        elif self._ack_s is None:
            self._ack_s = now_s + ACK_AFTER_S

    def _hurry(self, now_s: float) -> None:
        self._ack_s = now_s if self._ack_s is None else min(self._ack_s, now_s)
