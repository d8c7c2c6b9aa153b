"""State of a mission server's transfers: a plan being received, decided on, finished, or downloaded."""

from __future__ import annotations

from typing import Final

import msgspec

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.item_receiver import ItemReceiver
from gloc3.mavlink.services.plan import Plan, PlanResult, PlanType

REMEMBERED_S: Final = 30.0
REMINDERS: Final = 8
"""Repeated requests to a silent uploader for its last item, in case it has missed the acknowledgement."""
REMINDER_S: Final = 0.25
"""Shortest time between two of them."""
TIMEOUT_S: Final = 0.7
"""Interval of requests to the sender, s: stations wait 1.5 s for an answer to the last item."""


class PlanReceived(msgspec.Struct, frozen=True):
    """A plan was replaced, by an empty one when it was cleared."""

    kind: PlanType
    items: Plan
    sender: Address


class PlanOffered(msgspec.Struct, frozen=True):
    """A plan is complete (empty, to clear it) and `check` has left the decision to the owner, who calls `conclude`."""

    kind: PlanType
    items: Plan
    sender: Address


class SetCurrentRequested(msgspec.Struct, frozen=True):
    """Request to continue the mission at another item; the owner calls `set_current` to accept it."""

    number: int
    sender: Address


class IncomingPlan:
    """A plan that is coming in."""

    __slots__ = ("items", "sender")

    def __init__(self, sender: Address, items: ItemReceiver) -> None:
        self.sender = sender
        self.items = items


class PlanAcknowledgement:
    """The one acknowledgement of an upload, or of clearing one type of plan or all."""

    __slots__ = ("named", "result", "waiting")

    def __init__(self, named: int) -> None:
        self.named = named
        """The type of plan that it names."""
        self.waiting = 0
        """Plans that it waits for."""
        self.result = PlanResult.ACCEPTED


class Pending:
    """A plan whose owner has not decided yet."""

    __slots__ = ("answer", "last", "next_s", "offered")

    def __init__(
        self, offered: PlanOffered, answer: PlanAcknowledgement, last: MavlinkMessage | None, now_s: float
    ) -> None:
        self.offered = offered
        self.answer = answer
        self.last = last
        """The message with the last item; None where there is none."""
        self.next_s = now_s + TIMEOUT_S
        """When the last item is requested again, so that its sender keeps waiting."""


class Finished:
    """A finished upload whose sender may not know the result yet."""

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

    def is_requested_by(self, message: MavlinkMessage, sender: Address, now_s: float) -> bool:
        """Whether an item is this upload's last one once more, and not one of another plan."""
        return (
            sender == self.sender
            and now_s - self.ended_s < REMEMBERED_S
            and message.id == self.last.id
            and message.shape.encode(message) == self.last.shape.encode(self.last)  # as bytes, since NaN is no equal
        )


class PlanReader:
    """A client that downloads a plan, with a copy of the plan from the start of the download."""

    __slots__ = ("items", "last_s", "repeats")

    def __init__(self, items: Plan, now_s: float) -> None:
        self.items = items
        self.last_s = now_s
        self.repeats: tuple[int, int] = (-1, 0)
        """Last item requested with MISSION_REQUEST, and how often."""
