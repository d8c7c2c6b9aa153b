"""Arm authorization: answers the autopilot's requests to arm from the platform's summaries.

PX4 requests it from the system COM_ARM_AUTH_ID if COM_ARM_AUTH_REQ is set; the vehicle's own system id means this
companion.
MAVLink: an acceptance gives its validity in seconds in `result_param2`.
"""

from collections.abc import Callable
from typing import Final, Never

from gloc3.exchange.base import Exchange
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandServer
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import WELL, Summary

SILENT_S: Final = 3.0


class ArmAuthority:
    """Follows the summaries; denies arming without them, or while a required component is not healthy."""

    def __init__(self, exchange: Exchange, platform: str) -> None:
        self._latest: Envelope[Summary] | None = None
        self._unsubscribe = exchange.subscribe(f"{platform}/ci/summary", self._receive_summary)

    def close(self) -> None:
        """Listens no more."""
        self._unsubscribe()

    def _receive_summary(self, envelope: Envelope[Summary]) -> None:
        self._latest = envelope

    def why_not(self, now_s: float) -> str:
        """The reason why arming is denied now; empty if it is allowed."""
        if self._latest is None or now_s - self._latest.t_s > SILENT_S:
            return "the companion's command interface is down"
        health = self._latest.payload.health
        return "" if health in WELL else f"a required component is {health}"


ARM_AUTHORIZATION_REQUEST: Final = 3001
HOLDS_S: Final = 10
"""So long an acceptance holds."""
REASON_IS_REPORTED: Final = 1
"""MAV_ARM_AUTH_DENIED_REASON_NONE: the autopilot need say nothing more."""
WARNING: Final = 4
"""MAV_SEVERITY of the reason."""


class ArmPermissionRequest(Microservice[Never]):
    """Answers the autopilot's requests to arm; the reason of a refusal is sent as a status text.

    Args:
        own: MAVLink address of the sender.
        why_not: returns the reason against arming now; empty for none.
    """

    handles = frozenset({"COMMAND_LONG", "COMMAND_INT"})

    def __init__(self, own: Address, why_not: Callable[[], str]) -> None:
        super().__init__(own)
        self.autopilot: Address | None = None
        """Who may ask."""
        self._why_not = why_not
        self._server = MavCommandServer(own, {ARM_AUTHORIZATION_REQUEST})
        self._texts = StatusTextSender(own)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Answers a question of the autopilot; other commands are for others."""
        if sender != self.autopilot or message.command != ARM_AUTHORIZATION_REQUEST:
            return
        self._server.receive(message, sender, now_s)
        for request in self._server.events():
            reason = self._why_not()
            if reason:
                self._texts.send(WARNING, f"Arming not authorised: {reason}")
                self._server.answer(request, CommandResult.DENIED, now_s=now_s, result_param1=REASON_IS_REPORTED)
            else:
                self._server.answer(request, CommandResult.ACCEPTED, now_s=now_s, result_param2=HOLDS_S)

    def outgoing(self) -> list[MavlinkMessage]:
        """Texts before answers, so that the reason is there when the refusal is."""
        return [*self._texts.outgoing(), *self._server.outgoing()]
