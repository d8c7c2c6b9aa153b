"""The sender of reliable messages to one life of one peer: fragments, selective repeat, repeats at the end.

As in QUIC, every transmission has a serial number of its own, apart from the fragment's place. An acknowledgement lists
the fragments received and the latest serial. A fragment that was last sent clearly before that serial and is missing is
lost, and is repeated at once, without a timer. When nothing is left to be sent, fragments that are still open are
repeated without request, because the link is idle and lossy. When no acknowledgement arrives at all, one fragment is
sent from time to time until one does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from math import ceil, log
from typing import Any, Final

import msgspec

from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import CHUNK, Ack, Data
from gloc3.exchange.tunnel.layout import DUTIES, Lane
from gloc3.exchange.tunnel.path import RoundTrips
from gloc3.exchange.tunnel.reader import unwrap
from gloc3.messages.envelope import Envelope

MAX_FRAGMENTS: Final = 640
MAX_BODY: Final = CHUNK * MAX_FRAGMENTS
"""Bytes of a message, deflated if that helps: 70 kB."""
WINDOW: Final[dict[Lane, int]] = {Lane.URGENT: 8, Lane.ORDINARY: 16, Lane.BULK: 2, Lane.VIEW: 1}
"""Messages of a lane that may be under way at once; twice as many fit the five bits of `Data.base_delta`."""
MAX_WAITING: Final[dict[Lane, int]] = {Lane.URGENT: 16, Lane.ORDINARY: 128, Lane.BULK: 8, Lane.VIEW: 8}
"""Messages of a lane that may wait; further ones are refused."""
REORDERING: Final = 3
"""A frame counts as lost when one sent this many frames later has been received."""
LATE_ROUND_TRIPS: Final = 1.25
"""Also when a later one has been received, and it was sent this many round trips ago."""
MAX_COPIES: Final = 5
ENOUGH: Final = 1e-3
"""A fragment is repeated unasked until its loss is as improbable as this."""
COPY_SPACING_S: Final = 0.12
HURRIED_COPIES: Final = 2
"""So few messages of so few fragments are repeated unasked although something large waits."""
LOSS_WORTH_COPIES: Final = 0.02
SMALLEST_FLIGHT: Final = 24
ANSWER_GRACE_S: Final = 1.2
"""Time beyond a round trip for which frames are sent without an acknowledgement, s."""
LONGEST_PROBE_S: Final = 2.0


class OutgoingMessage(msgspec.Struct, frozen=True):
    """A message that is to be sent."""

    envelope: Envelope[Any]
    channel: int
    body: bytes
    lane: Lane
    submitted_s: float
    timeout_s: float
    """Time until it is given up, from its submission; in the lanes of large messages, from the last progress."""
    is_fence: bool = False
    """It waits in the bulk lane for an upload; later messages must not overtake it."""


class _Transfer:
    """One message and the state of its fragments."""

    __slots__ = ("acked", "copies", "count", "fresh", "full", "lost", "number", "outgoing", "sent_s", "serials")

    def __init__(self, number: int, outgoing: OutgoingMessage) -> None:
        self.number = number
        self.outgoing = outgoing
        self.count = max(1, -(-len(outgoing.body) // CHUNK))
        self.full = (1 << self.count) - 1
        self.acked = 0
        """Bits of the fragments that are there."""
        self.fresh = 0
        """The first fragment that was never sent."""
        self.lost: deque[int] = deque()
        self.serials = [-1] * self.count
        self.sent_s = [0.0] * self.count
        self.copies = bytearray(self.count)

    @property
    def was_sent(self) -> bool:
        """Whether every fragment was sent at least once, so that the message may have arrived."""
        return self.fresh == self.count

    def open_fragments(self) -> Iterator[int]:
        """Fragments that were sent and are not known to be there."""
        missing = ~self.acked & ((1 << self.fresh) - 1)
        while missing:
            low = missing & -missing
            yield low.bit_length() - 1
            missing ^= low


class ReliableSender:
    """All reliable messages to one life of one peer.

    Args:
        to_boot: the peer's boot number.
        first_number: higher than any that this process may have used towards that life.
        round_trips: of the path to the peer; updated here with the loss.
        counters: where repeats are counted.
    """

    def __init__(self, to_boot: int, first_number: int, round_trips: RoundTrips, counters: Counters) -> None:
        self.is_idle = True
        """Whether everything is done."""
        self._counters = counters
        self._to_boot = to_boot & 0xFFFF
        self._round_trips = round_trips
        self._lanes: dict[Lane, deque[_Transfer]] = {lane: deque() for lane in Lane}
        self._next_number = dict.fromkeys(Lane, first_number)
        self._progress_s = dict.fromkeys(Lane, 0.0)
        self._next_serial = 0
        self._highest = -1
        self._received = 0
        self._times_s: deque[tuple[int, float]] = deque()
        self._received_s = 0.0
        """When the last acknowledgement came."""
        self._sent_s = 0.0
        self._probes = 0

    @property
    def next_number(self) -> int:
        """Higher than every number used so far."""
        return max(self._next_number.values())

    def is_open(self, lane: Lane) -> bool:
        """Whether anything of a lane is not done."""
        return bool(self._lanes[lane])

    @property
    def is_fenced(self) -> bool:
        """Whether a message in the bulk lane must not be overtaken."""
        return any(transfer.outgoing.is_fence for transfer in self._lanes[Lane.BULK])

    def waiting(self) -> list[tuple[OutgoingMessage, bool]]:
        """Messages that are not done, and whether each may have arrived."""
        return [(transfer.outgoing, transfer.was_sent) for lane in Lane for transfer in self._lanes[lane]]

    def submit(self, outgoing: OutgoingMessage, now_s: float) -> str:
        """Takes a message; the answer is a reason against it, or empty."""
        lane = self._lanes[outgoing.lane]
        if len(outgoing.body) > MAX_BODY:
            return f"the message is too large: {len(outgoing.body)} bytes, {MAX_BODY} can be sent"
        if outgoing.lane is Lane.VIEW and self._replace(outgoing):
            return ""
        if len(lane) >= MAX_WAITING[outgoing.lane]:
            return f"{len(lane)} messages wait already"
        if not lane:
            self._progress_s[outgoing.lane] = now_s
        if self.is_idle:
            self._received_s = self._sent_s = now_s
        self.is_idle = False
        lane.append(_Transfer(self._next_number[outgoing.lane], outgoing))
        self._next_number[outgoing.lane] += 1
        return ""

    def _replace(self, outgoing: OutgoingMessage) -> bool:
        """Replaces a waiting message of the same channel that has not begun to be sent."""
        lane = self._lanes[outgoing.lane]
        for place, transfer in enumerate(lane):
            if transfer.outgoing.channel == outgoing.channel and not transfer.fresh:
                lane[place] = _Transfer(transfer.number, outgoing)
                self._counters.replaced += 1
                return True
        return False

    # --- what to send ---

    def has_work(self, lane: Lane) -> bool:
        """Whether a fragment of a lane is to be sent now, new or known to be lost."""
        if not self._lanes[lane]:
            return False
        may_begin = lane < Lane.BULK or self._may_fly
        return any(transfer.lost or (may_begin and transfer.fresh < transfer.count) for transfer in self._window(lane))

    def next_data(self, lane: Lane, now_s: float) -> Data | None:
        """The next fragment of a lane."""
        may_begin = lane < Lane.BULK or self._may_fly
        for transfer in self._window(lane):
            while transfer.lost:
                index = transfer.lost.popleft()
                if not transfer.acked >> index & 1:
                    self._counters.repeats += 1
                    transfer.copies[index] = 0
                    return self._data(lane, transfer, index, now_s)
            if may_begin and transfer.fresh < transfer.count:
                transfer.fresh += 1
                return self._data(lane, transfer, transfer.fresh - 1, now_s)
        return None

    def next_copy(self, now_s: float, *, is_idle: bool, lanes: Sequence[Lane] = DUTIES) -> Data | None:
        """The next unrequested repeat: the fragment sent longest ago.

        Args:
            now_s: the time.
            is_idle: there is nothing else to send; if not, only urgent messages, or a few short ones, are repeated.
            lanes: lanes to repeat from.
        """
        first = self._first_copy(lanes, is_idle=is_idle)
        if first is None or now_s < first[0]:
            return None
        _, lane, transfer, index = first
        transfer.copies[index] = transfer.copies[index] + 1 if transfer.copies[index] < self._copies else 0
        self._counters.repeats += 1
        return self._data(lane, transfer, index, now_s)

    def _first_copy(self, lanes: Sequence[Lane], *, is_idle: bool) -> tuple[float, Lane, _Transfer, int] | None:
        """Next fragment for an unrequested repeat, and when: a few times at short intervals, then once a round trip."""
        trips = self._round_trips
        if self.is_idle or trips.loss < LOSS_WORTH_COPIES or not any(map(self.is_open, lanes)):
            return None
        copies = self._copies
        slow_s = max(COPY_SPACING_S, LATE_ROUND_TRIPS * trips.smoothed_s)
        latest_s = self._received_s + trips.smoothed_s + ANSWER_GRACE_S
        best: tuple[float, Lane, _Transfer, int] | None = None
        for lane in lanes:
            if not is_idle and lane is not Lane.URGENT and len(self._lanes[lane]) > HURRIED_COPIES:
                continue
            for transfer in self._window(lane):
                if not is_idle and transfer.count > HURRIED_COPIES:
                    continue
                for index in transfer.open_fragments():
                    is_soon = transfer.copies[index] < copies
                    due_s = transfer.sent_s[index] + (COPY_SPACING_S if is_soon else slow_s)
                    may_copy = lane is Lane.URGENT or due_s < latest_s
                    if may_copy and (best is None or due_s < best[0]):
                        best = (due_s, lane, transfer, index)
        return best

    @property
    def _copies(self) -> int:
        """How often a fragment is repeated before an answer can be there."""
        return min(MAX_COPIES, ceil(log(ENOUGH) / log(min(self._round_trips.loss, 0.9))) - 1)

    @property
    def _may_fly(self) -> bool:
        """Whether so little is unanswered that more may be sent."""
        flight = self._next_serial - self._highest - 1
        return (
            flight < SMALLEST_FLIGHT or self._sent_s < self._received_s + self._round_trips.smoothed_s + ANSWER_GRACE_S
        )

    def _window(self, lane: Lane) -> Iterator[_Transfer]:
        transfers = self._lanes[lane]
        for position in range(min(len(transfers), WINDOW[lane])):
            transfer = transfers[position]
            if transfer.number >= transfers[0].number + 2 * WINDOW[lane]:
                return
            yield transfer

    def _data(self, lane: Lane, transfer: _Transfer, index: int, now_s: float) -> Data:
        serial = self._next_serial
        self._next_serial = serial + 1
        self._times_s.append((serial, now_s))
        self._sent_s = now_s
        transfer.serials[index] = serial
        transfer.sent_s[index] = now_s
        is_last = not any(self.has_work(other) for other in Lane)
        chunk = transfer.outgoing.body[index * CHUNK : (index + 1) * CHUNK]
        delta = transfer.number - self._lanes[lane][0].number
        return Data(self._to_boot, lane, is_last, delta, transfer.number, serial, index, transfer.count, chunk)

    # --- what comes back ---

    def acknowledge(self, ack: Ack, now_s: float) -> tuple[list[OutgoingMessage], float | None]:
        """Handles an acknowledgement; returns the messages now done, and the round trip if it can be measured."""
        highest = unwrap(ack.highest, max(self._highest, 0))
        if highest >= self._next_serial:
            self._go_on_after(highest, ack)
        self._received_s = now_s
        self._probes = 0
        round_trip_s = None
        if highest > self._highest:
            round_trip_s = self._advance(highest, ack, now_s)
        done: list[OutgoingMessage] = []
        for report in ack.lanes:
            transfers = self._lanes[report.lane]
            expected = unwrap(report.expected, transfers[0].number) if transfers else 0
            while transfers and transfers[0].number < expected and transfers[0].was_sent:
                done.append(transfers.popleft().outgoing)
                self._progress_s[report.lane] = now_s
            there = {expected + ahead: mask for ahead, mask in report.partial}
            for transfer in self._window(report.lane):
                if transfer.number in there:
                    mask = there[transfer.number]
                    acked = transfer.full if mask is None else mask & transfer.full
                    if acked & ~transfer.acked:
                        transfer.acked |= acked & ((1 << transfer.fresh) - 1)
                        self._progress_s[report.lane] = now_s
        self._declare_losses(now_s)
        self._find_work()
        return done, round_trip_s

    def _go_on_after(self, highest: int, ack: Ack) -> None:
        """Continues the serials that the peer remembers of an earlier sender of this process, which dropped the peer."""
        self._next_serial, self._highest, self._received = highest + 1, highest, ack.received
        self._times_s.clear()
        for transfer in (transfer for lane in self._lanes.values() for transfer in lane):
            transfer.serials = [highest if serial >= 0 else serial for serial in transfer.serials]

    def _advance(self, highest: int, ack: Ack, now_s: float) -> float | None:
        sent = highest - self._highest
        received = unwrap(ack.received, self._received)
        self._round_trips.count(sent, received - self._received)
        self._highest, self._received = highest, received
        round_trip_s = None
        while self._times_s and self._times_s[0][0] <= highest:
            serial, sent_s = self._times_s.popleft()
            if serial == highest and ack.delay_s < 1.0:
                round_trip_s = max(0.0, now_s - sent_s - ack.delay_s)
        return round_trip_s

    def _declare_losses(self, now_s: float) -> None:
        limit = self._highest - REORDERING
        late_s = now_s - LATE_ROUND_TRIPS * self._round_trips.smoothed_s
        for lane in Lane:
            for transfer in self._window(lane):
                serials, lost = transfer.serials, transfer.lost
                for index in transfer.open_fragments():
                    serial = serials[index]
                    if 0 <= serial <= limit or (0 <= serial < self._highest and transfer.sent_s[index] < late_s):
                        serials[index] = -1  # waits to be sent again
                        lost.append(index)

    def refuse(self, lane: Lane, number: int) -> OutgoingMessage | None:
        """Handles the peer's refusal of a message; returns it, or None where it is not known any more."""
        for transfer in list(self._window(lane)):
            if transfer.number & 0xFFFF == number and transfer.was_sent:
                self._drop(lane, transfer)
                return transfer.outgoing
        return None

    # --- time ---

    def expire(self, now_s: float) -> list[tuple[OutgoingMessage, bool]]:
        """Gives up messages that have waited too long; returns each with whether it may have arrived."""
        given_up: list[tuple[OutgoingMessage, bool]] = []
        if self.is_idle:
            return given_up
        for lane in Lane:
            for transfer in list(self._lanes[lane]):
                if now_s >= self._end_s(lane, transfer):
                    given_up.append((transfer.outgoing, transfer.was_sent))
                    self._drop(lane, transfer)
        return given_up

    def probe(self, now_s: float) -> None:
        """Sends something again when nothing has come back for long."""
        if not self.is_idle and now_s >= self._probe_s():
            self._probes += 1
            self._sent_s = now_s
            self._nudge()

    def next_s(self) -> float | None:
        """When `expire` or `probe` has something to do."""
        if self.is_idle:
            return None
        ends_s = (self._end_s(lane, transfer) for lane in Lane for transfer in self._lanes[lane])
        return min(self._probe_s(), *ends_s)

    def copy_s(self, lanes: Sequence[Lane] = DUTIES) -> float | None:
        """When `next_copy` has something to send."""
        first = self._first_copy(lanes, is_idle=True)
        return None if first is None else first[0]

    def _probe_s(self) -> float:
        wait_s = min(LONGEST_PROBE_S, self._round_trips.timeout_s * 1.5**self._probes + 0.1)
        return max(self._sent_s, self._received_s) + wait_s

    def _end_s(self, lane: Lane, transfer: _Transfer) -> float:
        outgoing = transfer.outgoing
        since_s = outgoing.submitted_s
        if lane >= Lane.BULK:
            since_s = max(since_s, self._progress_s[lane])
        return since_s + outgoing.timeout_s

    def _drop(self, lane: Lane, transfer: _Transfer) -> None:
        """Removes a message, and makes sure that the peer does not wait for it."""
        self._lanes[lane].remove(transfer)
        self._find_work()
        self._nudge()

    def _find_work(self) -> None:
        self.is_idle = not any(self._lanes.values())

    def _nudge(self) -> None:
        """Has one open fragment of each lane sent again, with the base of the lane in its frame."""
        for lane in Lane:
            for transfer in self._window(lane):
                if transfer.fresh and not transfer.lost:
                    index = next(transfer.open_fragments(), 0)
                    transfer.acked &= ~(1 << index)
                    transfer.serials[index] = -1
                    transfer.lost.append(index)
                if transfer.fresh:
                    break
