"""MAVLink operator control: other stations see and request control of the platform.

It concerns control of this component, which the missions obey; the autopilot has its own control.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.messages.command_interface import CiReply, Control, ControlVerb, Outcome
from gloc3_onboard.companion.pending_requests import PendingRequests

REQUEST_OPERATOR_CONTROL: Final = 32100
TAKEOVER_ALLOWED: Final = 2
"""GCS_CONTROL_STATUS_FLAGS: a request is granted at once."""
ANSWER_WITHIN_S: Final = 10.0

Answer = Callable[[CommandResult, str], None]


class OperatorControl:
    """Maps MAVLink's words for control to those of the command interface server.

    Args:
        requesting: reaches it.
        send: sends a message.
    """

    def __init__(self, requesting: PendingRequests, send: Callable[[MavlinkMessage], None]) -> None:
        self._requesting, self._send = requesting, send
        self._addresses: dict[int, Address] = {}
        """The last holder and requester that came by MAVLink, by system."""
        self._lenient = 0
        """System that allows others to take over while it holds control."""
        self._requested = ""
        """Last request reported to the holder."""

    def status(self) -> MavlinkMessage:
        """Current CONTROL_STATUS; a holder without a MAVLink system id cannot be reported."""
        holder = _system(self._requesting.control.holder)
        is_free = not self._requesting.control.holder or holder == self._lenient
        return message("CONTROL_STATUS", gcs_main=holder, flags=TAKEOVER_ALLOWED if is_free else 0)

    def request(self, request: MavCommandRequest, answer: Answer) -> None:
        """Carries out a MAV_CMD_REQUEST_OPERATOR_CONTROL.

        Raises:
            Refused: it cannot be; with the reason.
        """
        action, lets_others, _, wanted = request.params[:4]
        system = request.sender.system
        if wanted not in (0.0, float(system)):
            raise Refused(f"station {system} cannot request control for station {wanted:g}")
        if action not in (0.0, 1.0):
            raise Refused(f"{action:g} is neither 0 (release) nor 1 (request)")
        holder = self._requesting.control.holder
        if action == 0.0:
            self._requesting.require(system)
            if not holder:
                answer(CommandResult.ACCEPTED, "")
                return
            self._requesting.request(str(system), Control(verb=ControlVerb.RELEASE), _reported(answer))
        elif holder == str(system):
            self._lenient = system if lets_others == 1.0 else 0
            if self._lenient and self._requesting.control.requested_by:
                self._grant(system)
            answer(CommandResult.ACCEPTED, "")
        else:
            self._request(request, lets_others == 1.0, answer)

    def tick(self) -> None:
        """Notifies a MAVLink holder of requests for control, and grants them if the holder allows take-over."""
        control = self._requesting.control
        holder = _system(control.holder)
        if self._lenient and self._lenient != holder:
            self._lenient = 0
        if control.requested_by == self._requested:
            return
        self._requested = control.requested_by
        if not control.requested_by or holder not in self._addresses:
            return
        if holder == self._lenient:
            self._grant(holder)
            return
        target = self._addresses[holder]
        self._send(
            message(
                "COMMAND_LONG",
                target_system=target.system,
                target_component=target.component,
                command=REQUEST_OPERATOR_CONTROL,
                param1=1.0,
                param3=ANSWER_WITHIN_S,
                param4=float(_system(control.requested_by)),
            )
        )

    def holds(self, address: Address) -> None:
        """Remembers the address of an acting system."""
        holder = _system(self._requesting.control.holder)
        self._addresses = {one: at for one, at in self._addresses.items() if one == holder}
        self._addresses[address.system] = address

    def is_holder(self, address: Address) -> bool:
        """Whether control is held from exactly there."""
        return self._addresses.get(_system(self._requesting.control.holder)) == address

    def _request(self, request: MavCommandRequest, lets_others: bool, answer: Answer) -> None:
        system, control = request.sender.system, self._requesting.control
        if control.requested_by not in ("", str(system)):
            raise Refused(f"station {control.requested_by} has already requested control and waits for the answer")
        self.holds(request.sender)

        def requested(reply: CiReply) -> None:
            is_accepted = reply.outcome is Outcome.ACCEPTED
            is_released = bool(self._lenient) and _system(self._requesting.control.holder) == self._lenient
            is_granted = is_accepted and (reply.reason.startswith("granted") or is_released)
            self._lenient = system if is_granted and lets_others else self._lenient
            # the protocol's word for "the owner has been told of your wish"
            answer(CommandResult.ACCEPTED if is_granted else CommandResult.FAILED, "" if is_granted else reply.reason)

        self._requesting.request(str(system), Control(verb=ControlVerb.REQUEST), requested)

    def _grant(self, holder: int) -> None:
        grant = Control(verb=ControlVerb.GRANT, station=self._requesting.control.requested_by)
        with suppress(Refused):  # too much is asked at once: the holder's answer runs out of time, and can be had again
            self._requesting.request(str(holder), grant, lambda _reply: None)


def _reported(answer: Answer) -> Callable[[CiReply], None]:
    def then(reply: CiReply) -> None:
        is_accepted = reply.outcome is Outcome.ACCEPTED
        answer(CommandResult.ACCEPTED if is_accepted else CommandResult.DENIED, "" if is_accepted else reply.reason)

    return then


def _system(station: str) -> int:
    """The MAVLink system that a station's id names; 0 for none."""
    return int(station) if station.isascii() and station.isdigit() and int(station) < 256 else 0
