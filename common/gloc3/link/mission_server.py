"""The mission protocol on the vehicle: takes plans, gives them, and tells where in the mission it is.

A plan is replaced only when all of the new one is there and has been checked; after any failure the old one stands.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

import msgspec

from gloc3.link.item_receiver import ItemReceiver, Need
from gloc3.link.message import Address, MavlinkMessage
from gloc3.link.plan import ALL_TYPES, Plan, PlanResult, PlanType, read_item
from gloc3.link.round_trip import RoundTrip
from gloc3.link.service import Service

MOST_ITEMS: Final = 5000
READER_EXPIRES_S: Final = 60.0
MOST_READERS: Final = 16
REMEMBERED_S: Final = 30.0
REMINDERS: Final = 8
"""How often a silent uploader is asked for its last item once more, in case it has missed the acknowledgement."""
REMINDER_S: Final = 0.25
"""At least so much lies between two of them."""
FLOAT_AFTER: Final = 3
"""Who asks so often with MISSION_REQUEST for the same item cannot read MISSION_ITEM_INT."""
CURRENT_PERIOD_S: Final = 1.0


def accept_all(_kind: PlanType, _items: Plan) -> PlanResult:
    """Finds every plan acceptable."""
    return PlanResult.ACCEPTED


def serve_all(_sender: Address) -> bool:
    """Serves everybody."""
    return True


class PlanReceived(msgspec.Struct, frozen=True):
    """A plan was replaced, by an empty one when it was cleared."""

    kind: PlanType
    items: Plan
    sender: Address


class SetCurrentRequested(msgspec.Struct, frozen=True):
    """Somebody wants the mission to go on at another item; the owner does it with `set_current`, or not."""

    number: int
    sender: Address


class _Upload:
    """A plan that is coming in."""

    __slots__ = ("items", "sender")

    def __init__(self, sender: Address, items: ItemReceiver) -> None:
        self.sender = sender
        self.items = items


class _Finished:
    """An upload that is over; its sender may not know yet."""

    __slots__ = ("ended_s", "last", "reminders", "result", "sender", "timeout_s")

    def __init__(
        self, sender: Address, last: MavlinkMessage, result: PlanResult, timeout_s: float, now_s: float
    ) -> None:
        self.sender = sender
        self.last = last
        """The message with the last item."""
        self.result = result
        self.timeout_s = timeout_s
        self.ended_s = now_s
        self.reminders = REMINDERS

    @property
    def next_s(self) -> float | None:
        """When the sender is reminded again."""
        if not self.reminders:
            return None
        return self.ended_s + max(self.timeout_s, REMINDER_S) * (REMINDERS - self.reminders + 1)

    def is_asked_by(self, message: MavlinkMessage, sender: Address, now_s: float) -> bool:
        """Whether an item is this upload's last one once more, and not one of another plan."""
        return (
            sender == self.sender
            and now_s - self.ended_s < REMEMBERED_S
            and message.id == self.last.id
            and message.shape.encode(message) == self.last.shape.encode(self.last)  # as bytes, since NaN is no equal
        )


class _Reader:
    """Somebody who reads a plan, with the plan as it was when it began."""

    __slots__ = ("items", "last_s", "repeats")

    def __init__(self, items: Plan, now_s: float) -> None:
        self.items = items
        self.last_s = now_s
        self.repeats: tuple[int, int] = (-1, 0)
        """The item that was asked for last in the old way, and how often."""


class MissionServer(Service[PlanReceived | SetCurrentRequested]):
    """Holds a vehicle's plans.

    Args:
        own: as whom it speaks.
        kinds: the types of plan that it takes.
        check: says whether a whole plan is acceptable, before it replaces the old one.
        serves: whom it serves; a component that is also a client of another one must not serve that.
        tells_current: sends MISSION_CURRENT once a second.
    """

    handles = frozenset(
        {
            "MISSION_COUNT",
            "MISSION_ITEM_INT",
            "MISSION_ITEM",
            "MISSION_REQUEST_LIST",
            "MISSION_REQUEST_INT",
            "MISSION_REQUEST",
            "MISSION_ACK",
            "MISSION_CLEAR_ALL",
            "MISSION_SET_CURRENT",
            "MISSION_WRITE_PARTIAL_LIST",
        }
    )

    def __init__(
        self,
        own: Address,
        *,
        kinds: Collection[PlanType] = tuple(PlanType),
        check: Callable[[PlanType, Plan], PlanResult] = accept_all,
        serves: Callable[[Address], bool] = serve_all,
        tells_current: bool = True,
    ) -> None:
        super().__init__(own)
        self.plans: dict[PlanType, Plan] = dict.fromkeys(kinds, ())
        """The plans that are in force."""
        self.current = 0
        """The mission's item that is being done."""
        self.mission_state = 0
        """MISSION_STATE: 0 unknown, 1 none, 2 not started, 3 active, 4 paused, 5 complete."""
        self._check = check
        self._serves = serves
        self._uploads: dict[PlanType, _Upload] = {}
        self._finished: dict[PlanType, _Finished] = {}
        self._readers: dict[tuple[Address, PlanType], _Reader] = {}
        self._round_trips: dict[Address, RoundTrip] = {}
        self._tell_s: float | None = 0.0 if tells_current else None

    def set_current(self, number: int) -> None:
        """Says which item is being done; told at the next tick."""
        self.current = number
        if self._tell_s is not None:
            self._tell_s = 0.0

    def set_plan(self, kind: PlanType, items: Plan) -> None:
        """Replaces a plan from this side."""
        self.plans[kind] = items

    def reached(self, number: int) -> None:
        """Tells everybody that an item has been reached."""
        self._send("MISSION_ITEM_REACHED", seq=number)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a message of the protocol."""
        if not self._is_for_us(message) or not self._serves(sender):
            return
        if message.name == "MISSION_SET_CURRENT":
            if message.seq < len(self.plans.get(PlanType.MISSION, ())):
                self._events.append(SetCurrentRequested(message.seq, sender))
            elif self._tell_s is not None:
                self._tell_s = 0.0
            return
        if message.name == "MISSION_CLEAR_ALL" and message.mission_type == ALL_TYPES:
            self._clear(tuple(self.plans), ALL_TYPES, sender)
            return
        kind = next((kind for kind in self.plans if kind == message.mission_type), None)
        if kind is None:
            if message.name != "MISSION_ACK":
                self._acknowledge(sender, message.mission_type, PlanResult.UNSUPPORTED)
            return
        match message.name:
            case "MISSION_COUNT":
                self._begin(kind, message.count, sender, now_s)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                self._take(kind, message, sender, now_s)
            case "MISSION_REQUEST_LIST":
                self._list(kind, sender, now_s)
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                self._give(kind, message, sender, now_s)
            case "MISSION_ACK":
                self._hear_acknowledgement(kind, message, sender)
            case "MISSION_CLEAR_ALL":
                self._clear((kind,), kind, sender)
            case _:
                self._acknowledge(sender, kind, PlanResult.UNSUPPORTED)

    def tick(self, now_s: float) -> None:
        """Asks again for what is missing, gives up on who is gone, tells the current item."""
        for kind, upload in list(self._uploads.items()):
            match upload.items.need(now_s):
                case Need.REQUEST:
                    self._request(kind, upload.sender, upload.items.ask(now_s))
                case Need.SILENT | Need.EXHAUSTED:
                    del self._uploads[kind]
                    self._acknowledge(upload.sender, kind, PlanResult.CANCELLED)
        for kind, finished in self._finished.items():
            next_s = finished.next_s
            if next_s is not None and now_s >= next_s:
                finished.reminders -= 1
                self._request(kind, finished.sender, finished.last.seq)
        if self._tell_s is not None and now_s >= self._tell_s:
            self._tell_s = now_s + CURRENT_PERIOD_S
            total = len(self.plans.get(PlanType.MISSION, ()))
            self._send("MISSION_CURRENT", seq=self.current, total=total or 0xFFFF, mission_state=self.mission_state)

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        times_s = [upload.items.next_s() for upload in self._uploads.values()]
        times_s += [next_s for finished in self._finished.values() if (next_s := finished.next_s) is not None]
        if self._tell_s is not None:
            times_s.append(self._tell_s)
        return min(times_s, default=None)

    def _begin(self, kind: PlanType, count: int, sender: Address, now_s: float) -> None:
        active = self._uploads.get(kind)
        if active is not None and active.sender != sender:
            self._acknowledge(sender, kind, PlanResult.DENIED)
            return
        self._stop_reminding(sender)
        if count > MOST_ITEMS:
            self._uploads.pop(kind, None)
            self._acknowledge(sender, kind, PlanResult.NO_SPACE)
        elif count == 0:
            self._uploads.pop(kind, None)
            self._finish(kind, sender, ())
        elif active is not None and not active.items.items and active.items.count == count:
            self._request(kind, sender, active.items.ask(now_s))  # our first request was lost
        else:
            receiver = ItemReceiver(count, self._round_trip(sender), now_s)
            self._uploads[kind] = _Upload(sender, receiver)
            self._request(kind, sender, receiver.ask(now_s))

    def _take(self, kind: PlanType, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        upload = self._uploads.get(kind)
        if upload is None or upload.sender != sender:
            finished = self._finished.get(kind)
            if finished is not None and finished.is_asked_by(message, sender, now_s):
                self._acknowledge(sender, kind, finished.result)
            return
        if not upload.items.take(message.seq, read_item(message), now_s):
            return  # one that we have, or one ahead: the next is on its way, or will be asked for
        if upload.items.is_complete:
            del self._uploads[kind]
            result = self._finish(kind, sender, tuple(upload.items.items))
            timeout_s = self._round_trip(sender).timeout_s
            self._finished[kind] = _Finished(sender, message, result, timeout_s, now_s)
        else:
            self._request(kind, sender, upload.items.ask(now_s))

    def _finish(self, kind: PlanType, sender: Address, items: Plan) -> PlanResult:
        result = self._check(kind, items)
        if result is PlanResult.ACCEPTED:
            self._replace(kind, items, sender)
        self._acknowledge(sender, kind, result)
        return result

    def _replace(self, kind: PlanType, items: Plan, sender: Address) -> None:
        self.plans[kind] = items
        if kind is PlanType.MISSION:
            self.set_current(0)
        self._events.append(PlanReceived(kind, items, sender))

    def _clear(self, kinds: Collection[PlanType], named: int, sender: Address) -> None:
        self._stop_reminding(sender)
        result = PlanResult.ACCEPTED
        for kind in kinds:
            checked = self._check(kind, ())
            if checked is PlanResult.ACCEPTED:
                self._uploads.pop(kind, None)
                self._replace(kind, (), sender)
            else:
                result = checked
        self._acknowledge(sender, named, result)

    def _list(self, kind: PlanType, sender: Address, now_s: float) -> None:
        self._stop_reminding(sender)
        self._readers.pop((sender, kind), None)
        if len(self._readers) >= MOST_READERS:
            oldest = min(self._readers, key=lambda key: self._readers[key].last_s)
            del self._readers[oldest]
        items = self.plans[kind]
        self._readers[sender, kind] = _Reader(items, now_s)
        self._send_to(sender, "MISSION_COUNT", count=len(items), mission_type=kind)

    def _give(self, kind: PlanType, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        reader = self._readers.get((sender, kind))
        if reader is None or now_s - reader.last_s > READER_EXPIRES_S:
            return  # who never asked for the list is not talking to us as a server
        reader.last_s = now_s
        number = message.seq
        if number >= len(reader.items):
            self._acknowledge(sender, kind, PlanResult.INVALID_SEQUENCE)
            return
        item = reader.items[number]
        if message.name == "MISSION_REQUEST":
            before, repeats = reader.repeats
            reader.repeats = (number, repeats + 1 if number == before or repeats >= FLOAT_AFTER else 1)
            if reader.repeats[1] >= FLOAT_AFTER:
                self._outgoing.append(item.float_message(number, kind, sender))
                return
        self._outgoing.append(item.message(number, kind, sender))

    def _hear_acknowledgement(self, kind: PlanType, message: MavlinkMessage, sender: Address) -> None:
        self._readers.pop((sender, kind), None)
        upload = self._uploads.get(kind)
        if upload is not None and upload.sender == sender and message.type != PlanResult.ACCEPTED:
            del self._uploads[kind]  # cancelled by its sender

    def _stop_reminding(self, sender: Address) -> None:
        """Something new begins: the sender knows how the last transfer ended, or no longer cares."""
        for kind in [kind for kind, finished in self._finished.items() if finished.sender == sender]:
            del self._finished[kind]

    def _round_trip(self, sender: Address) -> RoundTrip:
        if sender not in self._round_trips and len(self._round_trips) >= MOST_READERS:
            del self._round_trips[next(iter(self._round_trips))]
        return self._round_trips.setdefault(sender, RoundTrip())

    def _request(self, kind: PlanType, target: Address, number: int) -> None:
        self._send_to(target, "MISSION_REQUEST_INT", seq=number, mission_type=kind)

    def _acknowledge(self, target: Address, kind: int, result: PlanResult) -> None:
        self._send_to(target, "MISSION_ACK", type=result, mission_type=kind)
