"""Client of the mission protocol: uploads, downloads and clears plans, and sets the current item."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from enum import Enum
from typing import Final, TypeAlias

import msgspec

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.round_trip import RESTLESS_S, RoundTrip
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.item_receiver import SILENT_S, ItemReceiver, Need
from gloc3.mavlink.services.plan import ALL_TYPES, ITEM_REFUSALS, Plan, PlanItem, PlanResult, PlanType, read_item

RESTART_S: Final = 6.0
"""Silence in the middle of a transfer after which it is restarted, s: the other end has given up, or restarted."""
RESTART_AT_THE_END_S: Final = 4.0
"""The same when only the acknowledgement is missing: it was lost, and the other end does not repeat it."""
SETTING_S: Final = 3.0
"""Time after which a vehicle that reports another current item has refused to set the requested one, s."""
MOST_RESTARTS: Final = 5


class Work(Enum):
    """Kinds of transfers."""

    UPLOAD = "upload"
    DOWNLOAD = "download"
    CLEAR = "clear"
    SET_CURRENT = "set current"


class Transfer:
    """One piece of work, and what became of it."""

    __slots__ = (
        "_budget",
        "_is_first_try",
        "_received_s",
        "_receiver",
        "_restarts",
        "_sent",
        "_tried_s",
        "items",
        "kind",
        "number",
        "result",
        "target",
        "work",
    )

    def __init__(self, work: Work, target: Address, kind: int, items: Plan = (), number: int = 0) -> None:
        self.work = work
        self.target = target
        self.kind = kind
        """PlanType, or 255 for clearing all."""
        self.items = items
        """Items to upload, or the downloaded ones at the end."""
        self.number = number
        """The item that shall be current."""
        self.result: PlanResult | None = None
        """None while it is not over."""
        self._sent = -1
        """Last requested item of an upload; -1 while the other end has not begun."""
        self._receiver: ItemReceiver | None = None
        self._budget = 100 + 4 * len(items)
        """So many items may be sent until a new beginning."""
        self._restarts = 0
        self._tried_s: float | None = None
        self._is_first_try = True
        self._received_s = 0.0

    @property
    def refused_index(self) -> int | None:
        """Index of the uploaded item that was refused; None where nothing was, or not for an item."""
        of_item = self.result is not None and self.result in ITEM_REFUSALS
        return self._sent if of_item and 0 <= self._sent < len(self.items) else None

    @property
    def progress(self) -> float:
        """From 0 to 1."""
        if self.result is PlanResult.ACCEPTED:
            return 1.0
        if self._receiver is not None:
            return len(self._receiver.items) / (self._receiver.count + 1)
        return (self._sent + 1) / (len(self.items) + 1)


class CurrentItem(msgspec.Struct, frozen=True):
    """A vehicle's current item has changed."""

    sender: Address
    number: int


class ItemReached(msgspec.Struct, frozen=True):
    """A vehicle has reached an item of its mission."""

    sender: Address
    number: int


MissionEvent: TypeAlias = Transfer | CurrentItem | ItemReached


class MissionClient(Microservice[MissionEvent]):
    """Transfers plans; a transfer is returned as an event when it ends. Further ones wait for their turn."""

    handles = frozenset(
        {
            "MISSION_REQUEST_INT",
            "MISSION_REQUEST",
            "MISSION_ACK",
            "MISSION_COUNT",
            "MISSION_ITEM_INT",
            "MISSION_ITEM",
            "MISSION_CURRENT",
            "MISSION_ITEM_REACHED",
        }
    )

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self.current: dict[Address, int] = {}
        """Current item of each vehicle that reports it."""
        self.states: dict[Address, int] = {}
        """MISSION_STATE of each vehicle that reports it with its current item."""
        self._active: Transfer | None = None
        self._waiting: deque[Transfer] = deque()
        self._round_trips: dict[Address, RoundTrip] = {}
        self._downloaded: Transfer | None = None

    def upload(
        self, target: Address, items: Sequence[PlanItem], *, now_s: float, kind: PlanType = PlanType.MISSION
    ) -> Transfer:
        """Gives a vehicle a plan; an empty one clears it."""
        return self._add(Transfer(Work.UPLOAD, target, kind, tuple(items)), now_s)

    def download(self, target: Address, *, now_s: float, kind: PlanType = PlanType.MISSION) -> Transfer:
        """Gets a vehicle's plan; it is in `items` when that is over."""
        return self._add(Transfer(Work.DOWNLOAD, target, kind), now_s)

    def clear(self, target: Address, *, now_s: float, kind: PlanType | None = None) -> Transfer:
        """Clears a plan of a vehicle, or all with None."""
        return self._add(Transfer(Work.CLEAR, target, ALL_TYPES if kind is None else kind), now_s)

    def set_current(self, target: Address, number: int, *, now_s: float) -> Transfer:
        """Continues the mission at an item."""
        return self._add(Transfer(Work.SET_CURRENT, target, PlanType.MISSION, number=number), now_s)

    def cancel(self, transfer: Transfer, now_s: float) -> None:
        """Stops a transfer; the vehicle keeps the plan that it had."""
        if transfer is self._active:
            self._acknowledge(transfer, PlanResult.CANCELLED)
            self._end(transfer, PlanResult.CANCELLED, now_s)
        elif transfer in self._waiting:
            self._waiting.remove(transfer)
            transfer.result = PlanResult.CANCELLED
            self._events.append(transfer)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a message of the protocol."""
        if message.name == "MISSION_ITEM_REACHED":
            self._events.append(ItemReached(sender, message.seq))
            return
        if message.name == "MISSION_CURRENT":
            self.states[sender] = getattr(message, "mission_state", 0)
            self._receive_current(message.seq, sender, now_s)
            return
        if not self._is_for_us(message):
            return
        transfer = self._active
        if transfer is None or transfer.target != sender or transfer.kind != message.mission_type:
            done = self._downloaded
            is_item = message.name in ("MISSION_ITEM_INT", "MISSION_COUNT")
            if is_item and done is not None and (done.target, done.kind) == (sender, message.mission_type):
                self._acknowledge(done, PlanResult.ACCEPTED)  # the first one was lost
            return
        match message.name:
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                self._give(transfer, message.seq, now_s)
            case "MISSION_COUNT":
                self._receive_count(transfer, message.count, now_s)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                self._handle(transfer, message, now_s)
            case _:
                self._receive_acknowledgement(transfer, PlanResult.read(message.type), now_s)

    def tick(self, now_s: float) -> None:
        """Repeats requests, restarts transfers, or gives up."""
        transfer = self._active
        if transfer is None:
            return
        if now_s >= self._last_received_s(transfer) + SILENT_S:
            self._end(transfer, PlanResult.NO_ANSWER, now_s)
        elif self._has_begun(transfer) and now_s >= self._restart_s(transfer):
            self._restart(transfer, now_s)
        elif transfer._receiver is not None:
            match transfer._receiver.need(now_s):
                case Need.REQUEST:
                    self._request(transfer, now_s)
                case Need.EXHAUSTED:
                    self._give_up(transfer, now_s)
        elif not self._has_begun(transfer) and now_s >= self._try_again_s(transfer):
            self._round_trip(transfer.target).missed()
            self._try(transfer, now_s)

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        transfer = self._active
        if transfer is None:
            return None
        if not self._has_begun(transfer):
            return min(self._try_again_s(transfer), self._last_received_s(transfer) + SILENT_S)
        if transfer._receiver is not None:
            return min(transfer._receiver.next_s(), self._restart_s(transfer))
        return self._restart_s(transfer)

    @staticmethod
    def _has_begun(transfer: Transfer) -> bool:
        """Whether the other end has answered, so that the transfer is under way."""
        return transfer._receiver is not None or transfer._sent >= 0

    @staticmethod
    def _last_received_s(transfer: Transfer) -> float:
        receiver = transfer._receiver
        return transfer._received_s if receiver is None else max(transfer._received_s, receiver.silent_since_s)

    def _restart_s(self, transfer: Transfer) -> float:
        is_at_the_end = transfer._receiver is None and transfer._sent + 1 == len(transfer.items)
        return self._last_received_s(transfer) + (RESTART_AT_THE_END_S if is_at_the_end else RESTART_S)

    def _try_again_s(self, transfer: Transfer) -> float:
        assert transfer._tried_s is not None
        timeout_s = self._round_trip(transfer.target).timeout_s
        return transfer._tried_s + (timeout_s if transfer._is_first_try else min(timeout_s, RESTLESS_S))

    def _add(self, transfer: Transfer, now_s: float) -> Transfer:
        self._waiting.append(transfer)
        self._begin_next(now_s)
        return transfer

    def _begin_next(self, now_s: float) -> None:
        if self._active is None and self._waiting:
            self._active = self._waiting.popleft()
            self._active._received_s = now_s
            self._downloaded = None
            self._try(self._active, now_s)

    def _restart(self, transfer: Transfer, now_s: float) -> None:
        transfer._received_s = self._last_received_s(transfer)
        transfer._receiver, transfer._sent = None, -1
        transfer._budget = 100 + 4 * len(transfer.items)
        if self._may_restart(transfer, now_s):
            self._try(transfer, now_s)

    def _may_restart(self, transfer: Transfer, now_s: float) -> bool:
        transfer._restarts += 1
        if transfer._restarts <= MOST_RESTARTS:
            return True
        self._give_up(transfer, now_s)
        return False

    def _give_up(self, transfer: Transfer, now_s: float) -> None:
        self._acknowledge(transfer, PlanResult.CANCELLED)
        self._end(transfer, PlanResult.TOO_MANY_LOSSES, now_s)

    def _try(self, transfer: Transfer, now_s: float) -> None:
        """Sends the first message of a transfer."""
        transfer._is_first_try = transfer._tried_s is None
        transfer._tried_s = now_s
        target, kind = transfer.target, transfer.kind
        match transfer.work:
            case Work.UPLOAD:
                self._send_to(target, "MISSION_COUNT", count=len(transfer.items), mission_type=kind)
            case Work.DOWNLOAD:
                self._send_to(target, "MISSION_REQUEST_LIST", mission_type=kind)
            case Work.CLEAR:
                self._send_to(target, "MISSION_CLEAR_ALL", mission_type=kind)
            case Work.SET_CURRENT:
                self._send_to(target, "MISSION_SET_CURRENT", seq=transfer.number)

    def _give(self, transfer: Transfer, number: int, now_s: float) -> None:
        if transfer.work is not Work.UPLOAD or number >= len(transfer.items):
            return
        if number > transfer._sent + 1:
            return  # of an earlier transfer; to answer would mix two plans
        if transfer._budget <= 0:
            self._give_up(transfer, now_s)
            return
        transfer._budget -= 1
        transfer._received_s = now_s
        transfer._sent = max(transfer._sent, number)
        self._outgoing.append(transfer.items[number].message(number, transfer.kind, transfer.target))

    def _receive_count(self, transfer: Transfer, count: int, now_s: float) -> None:
        if transfer.work is not Work.DOWNLOAD:
            return
        transfer._received_s = now_s
        receiver = transfer._receiver
        if receiver is not None and (receiver.count == count or not self._may_restart(transfer, now_s)):
            return  # the answer to a question that we repeated
        if count == 0:
            self._finish_download(transfer, (), now_s)
            return
        transfer._receiver = ItemReceiver(count, self._round_trip(transfer.target), now_s)
        self._request(transfer, now_s)

    def _handle(self, transfer: Transfer, message: MavlinkMessage, now_s: float) -> None:
        receiver = transfer._receiver
        if receiver is None or not receiver.receive(message.seq, read_item(message), now_s):
            return
        if receiver.is_complete:
            self._finish_download(transfer, tuple(receiver.items), now_s)
        else:
            self._request(transfer, now_s)

    def _finish_download(self, transfer: Transfer, items: Plan, now_s: float) -> None:
        transfer.items = items
        self._acknowledge(transfer, PlanResult.ACCEPTED)
        self._end(transfer, PlanResult.ACCEPTED, now_s)
        if self._active is None:
            self._downloaded = transfer

    def _receive_acknowledgement(self, transfer: Transfer, result: PlanResult, now_s: float) -> None:
        is_upload = transfer.work is Work.UPLOAD
        if result is PlanResult.ACCEPTED and (
            transfer.work is Work.DOWNLOAD or (is_upload and transfer._sent + 1 < len(transfer.items))
        ):
            return  # of an earlier transfer
        self._end(transfer, result, now_s)

    def _receive_current(self, number: int, sender: Address, now_s: float) -> None:
        if self.current.get(sender) != number and (sender in self.current or len(self.current) < 256):
            self.current[sender] = number
            self._events.append(CurrentItem(sender, number))
        transfer = self._active
        if transfer is not None and transfer.work is Work.SET_CURRENT and transfer.target == sender:
            if transfer.number == number:
                self._end(transfer, PlanResult.ACCEPTED, now_s)
            elif now_s >= transfer._received_s + SETTING_S:
                self._end(transfer, PlanResult.DENIED, now_s)

    def _end(self, transfer: Transfer, result: PlanResult, now_s: float) -> None:
        transfer.result = result
        self._active = None
        self._events.append(transfer)
        self._begin_next(now_s)

    def _request(self, transfer: Transfer, now_s: float) -> None:
        assert transfer._receiver is not None
        number = transfer._receiver.next_request(now_s)
        self._send_to(transfer.target, "MISSION_REQUEST_INT", seq=number, mission_type=transfer.kind)

    def _acknowledge(self, transfer: Transfer, result: PlanResult) -> None:
        self._send_to(transfer.target, "MISSION_ACK", type=result, mission_type=transfer.kind)

    def _round_trip(self, target: Address) -> RoundTrip:
        return self._round_trips.setdefault(target, RoundTrip())
