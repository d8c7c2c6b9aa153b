"""Server of the mission protocol: receives plans, sends them, and reports the current item.

A plan is replaced only when the new one is complete and has been checked; after any failure the previous one stays.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection
from typing import Final, NamedTuple

import msgspec

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.round_trip import RoundTrip
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.item_receiver import ItemReceiver, Need
from gloc3.mavlink.services.mission_transfers import (
    TIMEOUT_S,
    Finished,
    IncomingPlan,
    Pending,
    PlanAcknowledgement,
    PlanOffered,
    PlanReader,
    PlanReceived,
    SetCurrentRequested,
)
from gloc3.mavlink.services.plan import ALL_TYPES, Plan, PlanItem, PlanResult, PlanType, read_item

MOST_ITEMS: Final = 5000
READER_EXPIRES_S: Final = 60.0
MOST_READERS: Final = 16
FLOAT_AFTER: Final = 3
"""Number of MISSION_REQUESTs for one item after which the client gets MISSION_ITEM: it cannot read MISSION_ITEM_INT."""
CURRENT_PERIOD_S: Final = 1.0


def accept_item(kind: PlanType, index: int, count: int, item: PlanItem) -> PlanResult:
    """Accepts any item."""
    del kind, index, count, item
    return PlanResult.ACCEPTED


def accept_all(_kind: PlanType, _items: Plan) -> PlanResult:
    """Finds every plan acceptable."""
    return PlanResult.ACCEPTED


def serve_all(_sender: Address) -> bool:
    """Serves all senders."""
    return True


def admit_all(_sender: Address) -> bool:
    """Allows all senders to change plans."""
    return True


class MissionDialect(NamedTuple):
    """Properties of a mission server in which autopilots differ."""

    tells_current: bool = True
    """Sends MISSION_CURRENT once a second."""
    tells_ids: bool = False
    """Tells an id of each plan, by which a station sees that it has changed."""
    is_old: bool = False
    """Requests items by MISSION_REQUEST, as ArduPilot does."""


class MissionServer(Microservice[PlanReceived | PlanOffered | SetCurrentRequested]):
    """Holds a vehicle's plans.

    Args:
        own: address of this end.
        kinds: the supported types of plan.
        check: checks a complete plan before it replaces the old one; None leaves the decision to the owner, who
            receives `PlanOffered` and calls `conclude`; meanwhile the last item is requested again from the sender.
        check_item: checks an item as it comes, by kind, index, count and item; the first that is refused ends the upload.
        serves: which clients it serves; a component that is also a client of another one must not serve that one.
        admits: whether a sender may change plans now; checked before the first item, so that a sender without
            permission delays nobody.
        dialect: behaviour where autopilots differ.
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
        check: Callable[[PlanType, Plan], PlanResult | None] = accept_all,
        check_item: Callable[[PlanType, int, int, PlanItem], PlanResult] = accept_item,
        serves: Callable[[Address], bool] = serve_all,
        admits: Callable[[Address], bool] = admit_all,
        dialect: MissionDialect = MissionDialect(),  # noqa: B008 - immutable
    ) -> None:
        super().__init__(own)
        self._dialect = dialect
        self.plans: dict[PlanType, Plan] = dict.fromkeys(kinds, ())
        """The plans that are in force."""
        self.home: PlanItem | None = None
        """ArduPilot's item 0 of a mission: sent to any client that requests it, even without a mission."""
        self.current = 0
        """The mission's item that is being done."""
        self.mission_state = 0
        """MISSION_STATE: 0 unknown, 1 none, 2 not started, 3 active, 4 paused, 5 complete."""
        self._check, self._check_item = check, check_item
        self._serves, self._admits = serves, admits
        self._ids: dict[PlanType, tuple[Plan, int]] = {}
        self._uploads: dict[PlanType, IncomingPlan] = {}
        self._pending: dict[PlanType, Pending] = {}
        self._finished: dict[PlanType, Finished] = {}
        self._readers: dict[tuple[Address, PlanType], PlanReader] = {}
        self._round_trips: dict[Address, RoundTrip] = {}
        self._send_s: float | None = 0.0 if dialect.tells_current else None

    def set_current(self, number: int) -> None:
        """Sets the current item; reported at the next tick."""
        self.current = number
        if self._send_s is not None:
            self._send_s = 0.0

    def set_plan(self, kind: PlanType, items: Plan) -> None:
        """Replaces a plan from this side."""
        self.plans[kind] = items

    def is_pending(self, offered: PlanOffered) -> bool:
        """Whether an offered upload is undecided, and its sender has neither restarted nor cancelled it."""
        pending = self._pending.get(offered.kind)
        return pending is not None and pending.offered is offered

    def conclude(self, offered: PlanOffered, result: PlanResult, now_s: float) -> None:
        """Ends an offered upload; without effect where its sender has restarted or cancelled it meanwhile."""
        if not self.is_pending(offered):
            return
        kind = offered.kind
        pending = self._pending.pop(kind)
        self._end(pending.offered, pending.answer, pending.last, result, now_s)

    def current_message(self) -> MavlinkMessage:
        """Current MISSION_CURRENT."""
        total = len(self.plans.get(PlanType.MISSION, ()))
        return make(
            "MISSION_CURRENT",
            seq=self.current,
            total=total or 0xFFFF,
            mission_state=self.mission_state,
            mission_id=self.plan_id(PlanType.MISSION),
            fence_id=self.plan_id(PlanType.FENCE),
            rally_points_id=self.plan_id(PlanType.RALLY),
        )

    def plan_id(self, kind: int) -> int:
        """Id of a plan, different for each plan; 0 for an empty one, and where ids are not reported."""
        known = next((one for one in self.plans if one == kind), None)
        if not self._dialect.tells_ids or known is None or not self.plans[known]:
            return 0
        items = self.plans[known]
        kept = self._ids.get(known)
        if kept is None or kept[0] is not items:
            kept = self._ids[known] = (items, zlib.crc32(msgspec.msgpack.encode(items)) or 1)
        return kept[1]

    def reached(self, number: int) -> None:
        """Reports to all clients that an item has been reached."""
        self._send("MISSION_ITEM_REACHED", seq=number)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a message of the protocol."""
        if not self._is_for_us(message) or not self._serves(sender):
            return
        if message.name == "MISSION_SET_CURRENT":
            if message.seq < len(self.plans.get(PlanType.MISSION, ())):
                self._events.append(SetCurrentRequested(message.seq, sender))
            elif self._send_s is not None:
                self._send_s = 0.0
            return
        if message.name == "MISSION_CLEAR_ALL" and message.mission_type == ALL_TYPES:
            self._clear(tuple(self.plans), ALL_TYPES, sender, now_s)
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
                self._handle(kind, message, sender, now_s)
            case "MISSION_REQUEST_LIST":
                self._list(kind, sender, now_s)
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                self._give(kind, message, sender, now_s)
            case "MISSION_ACK":
                self._receive_acknowledgement(kind, message, sender)
            case "MISSION_CLEAR_ALL":
                self._clear((kind,), kind, sender, now_s)
            case _:
                self._acknowledge(sender, kind, PlanResult.UNSUPPORTED)

    def tick(self, now_s: float) -> None:
        """Requests missing items, ends transfers of lost peers, reports the current item."""
        for kind, upload in list(self._uploads.items()):
            match upload.items.need(now_s):
                case Need.REQUEST:
                    self._request(kind, upload.sender, upload.items.next_request(now_s))
                case Need.SILENT | Need.EXHAUSTED:
                    del self._uploads[kind]
                    self._acknowledge(upload.sender, kind, PlanResult.CANCELLED)
        for kind, pending in self._pending.items():
            if pending.last is not None and now_s >= pending.next_s:
                pending.next_s = now_s + TIMEOUT_S
                self._request(kind, pending.offered.sender, pending.last.seq)
        for kind, finished in self._finished.items():
            next_s = finished.next_s
            if next_s is not None and now_s >= next_s:
                finished.reminders -= 1
                self._request(kind, finished.sender, finished.last.seq)
        if self._send_s is not None and now_s >= self._send_s:
            self._send_s = now_s + CURRENT_PERIOD_S
            self._outgoing.append(self.current_message())

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        times_s = [upload.items.next_s() for upload in self._uploads.values()]
        times_s += [next_s for finished in self._finished.values() if (next_s := finished.next_s) is not None]
        times_s += [pending.next_s for pending in self._pending.values() if pending.last is not None]
        if self._send_s is not None:
            times_s.append(self._send_s)
        return min(times_s, default=None)

    def _begin(self, kind: PlanType, count: int, sender: Address, now_s: float) -> None:
        active = self._uploads.get(kind)
        is_accepted = (active is not None and active.sender != sender) or self._is_pending_for_another(kind, sender)
        if is_accepted or not self._admits(sender):
            self._acknowledge(sender, kind, PlanResult.DENIED)
            return
        self._stop_reminding(sender)
        self._pending.pop(kind, None)
        if count > MOST_ITEMS:
            self._uploads.pop(kind, None)
            self._acknowledge(sender, kind, PlanResult.NO_SPACE)
        elif count == 0:
            self._uploads.pop(kind, None)
            self._judge(kind, (), sender, PlanAcknowledgement(kind), None, now_s)
        elif active is not None and not active.items.items and active.items.count == count:
            self._request(kind, sender, active.items.next_request(now_s))  # our first request was lost
        else:
            receiver = ItemReceiver(count, self._round_trip(sender), now_s)
            self._uploads[kind] = IncomingPlan(sender, receiver)
            self._request(kind, sender, receiver.next_request(now_s))

    def _handle(self, kind: PlanType, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        upload = self._uploads.get(kind)
        if upload is None or upload.sender != sender:
            finished = self._finished.get(kind)
            if finished is not None and finished.is_requested_by(message, sender, now_s):
                self._acknowledge(sender, kind, finished.result)
            return
        item = read_item(message)
        if not upload.items.receive(message.seq, item, now_s):
            return  # one that we have, or one ahead: the next is on its way, or will be asked for
        result = self._check_item(kind, message.seq, upload.items.count, item)
        if result is not PlanResult.ACCEPTED:
            del self._uploads[kind]
            self._acknowledge(sender, kind, result)
            return
        if upload.items.is_complete:
            del self._uploads[kind]
            self._judge(kind, tuple(upload.items.items), sender, PlanAcknowledgement(kind), message, now_s)
        else:
            self._request(kind, sender, upload.items.next_request(now_s))

    def _judge(
        self,
        kind: PlanType,
        items: Plan,
        sender: Address,
        answer: PlanAcknowledgement,
        last: MavlinkMessage | None,
        now_s: float,
    ) -> None:
        """Has a plan checked, now or by its owner."""
        offered = PlanOffered(kind, items, sender)
        result = self._check(kind, items)
        answer.waiting += 1
        if result is None:
            self._pending[kind] = Pending(offered, answer, last, now_s)
            self._events.append(offered)
        else:
            self._end(offered, answer, last, result, now_s)

    def _end(
        self,
        offered: PlanOffered,
        answer: PlanAcknowledgement,
        last: MavlinkMessage | None,
        result: PlanResult,
        now_s: float,
    ) -> None:
        kind, sender = offered.kind, offered.sender
        if result is PlanResult.ACCEPTED:
            self._replace(kind, offered.items, sender)
        else:
            answer.result = result
        answer.waiting -= 1
        if not answer.waiting:
            self._acknowledge(sender, answer.named, answer.result)
        if last is not None:
            self._finished[kind] = Finished(sender, last, result, self._round_trip(sender).timeout_s, now_s)

    def _replace(self, kind: PlanType, items: Plan, sender: Address) -> None:
        self.plans[kind] = items
        self._uploads.pop(kind, None)
        if kind is PlanType.MISSION:
            self.set_current(0)
        self._events.append(PlanReceived(kind, items, sender))

    def _clear(self, kinds: Collection[PlanType], named: int, sender: Address, now_s: float) -> None:
        if any(self._is_pending_for_another(kind, sender) for kind in kinds) or not self._admits(sender):
            self._acknowledge(sender, named, PlanResult.DENIED)
            return
        pending = [self._pending[kind] for kind in kinds if kind in self._pending]
        if any(one.answer.named == named and not one.offered.items for one in pending):
            return  # asked again while it is being decided
        self._stop_reminding(sender)
        answer = PlanAcknowledgement(named)
        answer.waiting = 1  # so that nothing is said before all have been judged
        for kind in kinds:
            self._judge(kind, (), sender, answer, None, now_s)
        answer.waiting -= 1
        if not answer.waiting:
            self._acknowledge(sender, named, answer.result)

    def _is_pending_for_another(self, kind: PlanType, sender: Address) -> bool:
        pending = self._pending.get(kind)
        return pending is not None and pending.offered.sender != sender

    def _list(self, kind: PlanType, sender: Address, now_s: float) -> None:
        self._stop_reminding(sender)
        self._readers.pop((sender, kind), None)
        if len(self._readers) >= MOST_READERS:
            oldest = min(self._readers, key=lambda key: self._readers[key].last_s)
            del self._readers[oldest]
        items = self.plans[kind]
        self._readers[sender, kind] = PlanReader(items, now_s)
        self._send_to(sender, "MISSION_COUNT", count=len(items), mission_type=kind, opaque_id=self.plan_id(kind))

    def _give(self, kind: PlanType, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        if self.home is not None and kind is PlanType.MISSION and message.seq == 0:
            is_float = message.name == "MISSION_REQUEST"
            make_item = self.home.float_message if is_float else self.home.message
            self._outgoing.append(make_item(0, kind, sender))
            return
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
            if self._dialect.is_old or reader.repeats[1] >= FLOAT_AFTER:
                self._outgoing.append(item.float_message(number, kind, sender))
                return
        self._outgoing.append(item.message(number, kind, sender))

    def _receive_acknowledgement(self, kind: PlanType, message: MavlinkMessage, sender: Address) -> None:
        self._readers.pop((sender, kind), None)
        upload = self._uploads.get(kind)
        if upload is not None and upload.sender == sender and message.type != PlanResult.ACCEPTED:
            del self._uploads[kind]  # cancelled by its sender
        pending = self._pending.get(kind)
        if pending is not None and pending.offered.sender == sender and message.type != PlanResult.ACCEPTED:
            del self._pending[kind]

    def _stop_reminding(self, sender: Address) -> None:
        """Stops the reminders at a new transfer: the sender knows how the last one ended, or no longer needs to."""
        for kind in [kind for kind, finished in self._finished.items() if finished.sender == sender]:
            del self._finished[kind]

    def _round_trip(self, sender: Address) -> RoundTrip:
        if sender not in self._round_trips and len(self._round_trips) >= MOST_READERS:
            del self._round_trips[next(iter(self._round_trips))]
        return self._round_trips.setdefault(sender, RoundTrip())

    def _request(self, kind: PlanType, target: Address, number: int) -> None:
        name = "MISSION_REQUEST" if self._dialect.is_old else "MISSION_REQUEST_INT"
        self._send_to(target, name, seq=number, mission_type=kind)

    def _acknowledge(self, target: Address, kind: int, result: PlanResult) -> None:
        plan_id = self.plan_id(kind) if result is PlanResult.ACCEPTED else 0
        self._send_to(target, "MISSION_ACK", type=result, mission_type=kind, opaque_id=plan_id)
