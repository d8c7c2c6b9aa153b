"""Interface of MAVLink microservices: plain objects driven by messages and the time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Generic, TypeVar

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage

Event = TypeVar("Event")


class Microservice(ABC, Generic[Event]):
    """One end of one microservice, without I/O and without a clock.

    It is driven by `receive` and `tick`; after either, `outgoing` holds the messages to send and `events` the events.
    `tick` may be called at any time and does what is due; `next_tick_s` is the latest time for it.
    """

    handles: ClassVar[frozenset[str]] = frozenset()
    """Names of the messages that it handles; others need not be decoded for it."""

    def __init__(self, own: Address) -> None:
        self.own = own
        """Address of this end."""
        self._outgoing: list[MavlinkMessage] = []
        self._events: list[Event] = []

    @abstractmethod
    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a message; messages addressed to others are ignored."""

    def tick(self, now_s: float) -> None:
        """Runs what is due."""

    def next_tick_s(self) -> float | None:
        """When `tick` has something to do, unless a message comes before; None while only a message can help."""
        return None

    def outgoing(self) -> list[MavlinkMessage]:
        """What is to be sent, in order; asking empties it."""
        if not self._outgoing:
            return []
        waiting, self._outgoing = self._outgoing, []
        return waiting

    def events(self) -> list[Event]:
        """What has happened, in order; asking empties it."""
        if not self._events:
            return []
        events, self._events = self._events, []
        return events

    def _send(self, name: str, **fields: Any) -> None:
        self._outgoing.append(make(name, **fields))

    def _send_to(self, target: Address, name: str, **fields: Any) -> None:
        fields["target_system"], fields["target_component"] = target
        self._outgoing.append(make(name, **fields))

    def _is_for_us(self, message: MavlinkMessage) -> bool:
        """Whether a message with an address is meant for us, alone or among others."""
        return message.target_system in (0, self.own.system) and message.target_component in (0, self.own.component)


def earliest(*times_s: float | None) -> float | None:
    """The first of some times of which any may be "never" (None)."""
    return min((t_s for t_s in times_s if t_s is not None), default=None)
