"""Sends requests of MAVLink systems to the command interface server, as our stations do: one path, one log."""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.errors import Refused
from gloc3.exchange.base import Exchange, Publisher
from gloc3.mavlink.message import Address
from gloc3.messages.command_interface import AnyBody, CiReply, CiRequest, Control, ControlVerb, Outcome
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ControlState, MissionSummary
from gloc3.network.rights import Rights
from gloc3.network.rights_file import Right

ANSWER_S: Final = 15.0
"""Longer than the server itself waits for a component, or for a fence to be in the autopilot."""
MOST_OPEN: Final = 16
"""Requests that wait for an answer; each is written to disk before it is carried out."""

Then = Callable[[CiReply], None]


class NotInControl(Refused):
    """Another station holds control."""


class _Open(NamedTuple):
    then: Then
    until_s: float


class PendingRequests:
    """Requests of MAVLink clients to the command interface server; one instance a process.

    Commands that need control are refused here for all but its holder, so that strangers reach neither the server nor
    its journal.

    Args:
        exchange: the platform's middleware.
        platform: the platform's name.
        boot: random number of this start of the process.
        now_s: returns the time.
        rights: of the network's members.
        changed: called after an answer, or a change of control or mission.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: str,
        boot: int,
        now_s: Callable[[], float],
        rights: Rights,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.control = ControlState(holder="")
        """Latest control state."""
        self.mission = MissionSummary(name="", digest="", state="")
        """Latest summary of the loaded mission."""
        self.acted: Callable[[Address], None] = lambda _sender: None
        """Called with the sender of each command that needs control."""
        self.members: Final[dict[str, str]] = {}
        """Member of the network for whom each MAVLink system speaks: that of the link on which it was heard last."""
        self._rights = rights
        self._platform, self._boot, self.now_s, self._changed = platform, boot, now_s, changed
        self._publisher = Publisher(exchange, platform, "companion", boot)
        self._sequence = 0
        self._open: dict[tuple[str, int], _Open] = {}
        self._unsubscribe = [
            exchange.subscribe(f"{platform}/ci/reply", self._receive_reply),
            exchange.subscribe(f"{platform}/ci/control", self._request_control),
            exchange.subscribe(f"{platform}/ci/mission", self._receive_mission),
        ]

    def close(self) -> None:
        """Unsubscribes; pending requests are not answered."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        self._open.clear()

    def require(self, system: int) -> None:
        """Refuses a system while another one holds control.

        Raises:
            NotInControl: another system holds control.
        """
        if self.control.holder not in ("", str(system)):
            raise NotInControl(f"station {self.control.holder} holds control")

    def may(self, system: int, right: Right) -> bool:
        """Whether a system has a right, for what no request to the command interface is needed."""
        return self._rights.may(self.members.get(str(system), ""), right)

    def obtain(self, sender: Address, then: Callable[[str], None]) -> None:
        """Has a system hold control: it is requested while it is free, as other programs cannot.

        Args:
            sender: the system's address.
            then: called with the reason for a refusal, or with nothing once it holds control.

        Raises:
            Refused: another system holds control, or too many requests are pending.
        """
        self.require(sender.system)

        def granted(reply: CiReply) -> None:
            is_granted = reply.outcome is Outcome.ACCEPTED
            if is_granted:
                self.acted(sender)
            then("" if is_granted else reply.reason)

        if self.control.holder:
            then("")
        else:
            self.request(str(sender.system), Control(verb=ControlVerb.REQUEST), granted)

    def act(self, sender: Address, body: AnyBody, then: Then) -> None:
        """Sends a request that needs control. While control is free, it is requested first, as other programs cannot.

        Raises:
            Refused: another system holds control, or too many requests are pending.
        """
        system = sender.system
        self.require(system)

        def ended(reply: CiReply) -> None:
            if reply.outcome is Outcome.ACCEPTED:
                self.acted(sender)
            then(reply)

        def granted(reply: CiReply) -> None:
            if reply.outcome is not Outcome.ACCEPTED:
                then(reply)
                return
            try:
                self.request(str(system), body, ended)
            except Refused as refusal:
                then(msgspec.structs.replace(reply, outcome=Outcome.REFUSED, reason=str(refusal)))

        if self.control.holder:
            self.request(str(system), body, ended)
        else:
            self.request(str(system), Control(verb=ControlVerb.REQUEST), granted)

    def request(self, sender: str, body: AnyBody, then: Then) -> None:
        """Sends a request; `then` is called with the reply, or after a time-out with *unknown*.

        Raises:
            Refused: too many requests are pending.
        """
        if len(self._open) >= MOST_OPEN:
            raise Refused(f"busy: {MOST_OPEN} requests are waiting")
        self._sequence += 1
        now_s = self.now_s()
        member = self.members.get(sender, "")
        request = CiRequest(sender=sender, boot=self._boot, sequence=self._sequence, body=body, member=member)
        self._open[sender, self._sequence] = _Open(then, now_s + ANSWER_S)
        self._publisher.publish(f"{self._platform}/ci/request", request, now_s)

    def tick(self, now_s: float) -> None:
        """Times out pending requests."""
        for key, waiting in [item for item in self._open.items() if now_s >= item[1].until_s]:
            del self._open[key]
            waiting.then(
                CiReply(
                    sender=key[0],
                    boot=self._boot,
                    sequence=key[1],
                    outcome=Outcome.UNKNOWN,
                    reason="the command interface has not answered",
                )
            )

    def next_tick_s(self) -> float | None:
        """When the first has waited for too long."""
        return min((waiting.until_s for waiting in self._open.values()), default=None)

    def _receive_reply(self, envelope: Envelope[Any]) -> None:
        reply = envelope.payload
        if reply.boot == self._boot:
            waiting = self._open.pop((reply.sender, reply.sequence), None)
            if waiting is not None:
                waiting.then(reply)
                self._changed()

    def _request_control(self, envelope: Envelope[ControlState]) -> None:
        is_new, self.control = envelope.payload != self.control, envelope.payload
        if is_new:
            self._changed()

    def _receive_mission(self, envelope: Envelope[MissionSummary]) -> None:
        before, self.mission = self.mission, envelope.payload
        if (before.digest, before.state) != (self.mission.digest, self.mission.state):
            self._changed()
