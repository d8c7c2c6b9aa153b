"""State of a mission server's transfers: a plan being received, decided on, finished, or downloaded."""

from __future__ import annotations

from typing import Final

import msgspec

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.item_receiver import ItemReceiver
from gloc3.mavlink.services.plan import Plan, PlanResult, PlanType

REMEMBERED_S: Final = 30.0
REMINDERS: Final = 8
"""How often a silent uploader is asked for its last item once more, in case it has missed the acknowledgement."""
REMINDER_S: Final = 0.25
"""At least so much lies between two of them."""
TIMEOUT_S: Final = 0.7
"""Stations wait 1.5 s for what comes behind the last item."""


class PlanReceived(msgspec.Struct, frozen=True):
    """A plan was replaced, by an empty one when it was cleared."""

    kind: PlanType
    items: Plan
    sender: Address


class PlanOffered(msgspec.Struct, frozen=True):
    """All of a plan is there (nothing, to clear it) and `check` has left it to the owner, who ends it with `conclude`."""

    kind: PlanType
    items: Plan
    sender: Address


class SetCurrentRequested(msgspec.Struct, frozen=True):
    """Somebody wants the mission to go on at another item; the owner does it with `set_current`, or not."""

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
        """When its sender is asked for that item once more, so that he goes on waiting."""


class Finished:
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

    def is_requested_by(self, message: MavlinkMessage, sender: Address, now_s: float) -> bool:
        """Whether an item is this upload's last one once more, and not one of another plan."""
        return (
            sender == self.sender
            and now_s - self.ended_s < REMEMBERED_S
            and message.id == self.last.id
            and message.shape.encode(message) == self.last.shape.encode(self.last)  # as bytes, since NaN is no equal
        )


class PlanReader:
    """Somebody who reads a plan, with the plan as it was when it began."""

    __slots__ = ("items", "last_s", "repeats")

    def __init__(self, items: Plan, now_s: float) -> None:
        self.items = items
        self.last_s = now_s
        self.repeats: tuple[int, int] = (-1, 0)
        """The item that was asked for last in the old way, and how often."""
