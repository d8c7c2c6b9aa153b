"""The command protocol of the onboard computer: mission and message commands; others are refused with a reason.

Only commands addressed to it are handled: broadcast commands are the autopilot's and must not run twice.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from gloc3.errors import Refused
from gloc3.mavlink.codec import enum_name
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import CancelServer, CommandCancel, MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL, STREAM_COMMANDS, StreamScheduler
from gloc3.mavlink.services.version import REQUEST_AUTOPILOT_CAPABILITIES, VersionServer
from gloc3.messages.command_interface import AnyBody, CiReply, Outcome, RequestAction, Steer, Verb
from gloc3.mission.model.states import ActionState
from gloc3_onboard.companion.operator_control import REQUEST_OPERATOR_CONTROL, OperatorControl
from gloc3_onboard.companion.pending_requests import NotInControl, PendingRequests

MISSION_START: Final = 300
FASTEST_HZ: Final = 10.0
"""Greatest rate granted to observers, so that they do not fill a radio, Hz."""
PROGRESS_AFTER_S: Final = 0.4
PROGRESS_EVERY_S: Final = 1.0
_OPEN: Final = (ActionState.RUNNING, ActionState.PAUSED)
_NEVER: Final[Mapping[int, str]] = {
    176: "the onboard computer has no modes: ask the autopilot",
    185: "flights are not terminated by the onboard computer: ask the autopilot",
    224: "a mission cannot start at an item",
    400: "the onboard computer does not arm by command: start a mission, or ask the autopilot",
}
"""What people may expect, and why it is not done."""


class _Running:
    """A command without a final answer yet."""

    __slots__ = ("is_cancelled", "next_s", "request")

    def __init__(self, request: MavCommandRequest, now_s: float) -> None:
        self.request = request
        self.next_s = now_s + PROGRESS_AFTER_S
        self.is_cancelled = False


class Commands:
    """Carries out commands.

    Args:
        own: MAVLink address of the companion.
        requesting: requests to the command interface server.
        control: operator control.
        streams: messages available on request.
        version: returns the component's version and capabilities.
        serves: whether a sender is served.
        report: called with the reason of each refusal.
    """

    def __init__(
        self,
        own: Address,
        requesting: PendingRequests,
        control: OperatorControl,
        streams: StreamScheduler,
        version: VersionServer,
        serves: Callable[[Address], bool],
        report: Callable[[str], None],
    ) -> None:
        self.refused = 0
        """Commands that were turned down."""
        self._requesting, self._control, self._streams, self._version = requesting, control, streams, version
        self._report = report
        self.server: Final = MavCommandServer(own, serves=lambda one: one.target == own and serves(one.sender))
        self.cancels: Final = CancelServer(own)
        self._running: list[_Running] = []
        self._more: dict[int, Callable[[MavCommandRequest], None]] = {}

    def add(self, handlers: Mapping[int, Callable[[MavCommandRequest], None]]) -> None:
        """Has more commands carried out at once; a handler raises `Refused` with the reason for a refusal."""
        self._more |= handlers

    def tick(self, now_s: float) -> None:
        """Carries out received commands, and reports progress of long ones."""
        for request in self.server.events():
            self._run(request, now_s)
        for cancel in self.cancels.events():
            self._cancel(cancel)
        for running in self._running:
            if now_s >= running.next_s:
                running.next_s = now_s + PROGRESS_EVERY_S
                self.server.answer(running.request, CommandResult.IN_PROGRESS, now_s=now_s)

    def next_tick_s(self) -> float | None:
        """Time of the next progress report."""
        return min((running.next_s for running in self._running), default=None)

    def _run(self, request: MavCommandRequest, now_s: float) -> None:
        try:
            if request.command not in HANDLED and request.command not in self._more:
                reason = _NEVER.get(request.command, "not supported by the onboard computer")
                self._answer(request, CommandResult.UNSUPPORTED, reason)
                return
            result = self._answer_query(request, now_s)
            if result is not None:
                self._answer(request, result, "" if result is CommandResult.ACCEPTED else "it is not available")
            elif request.command == REQUEST_OPERATOR_CONTROL:
                running = self._begin(request, now_s)
                self._control.request(request, lambda found, reason: self._end(running, found, reason))
            elif request.command in self._more:
                self._carry_out(request)
            else:
                self._act(request, _BODIES[request.command](self, request), now_s)
        except NotInControl as refusal:
            self._refuse(request, CommandResult.NOT_IN_CONTROL, str(refusal))
        except Refused as refusal:
            self._refuse(request, CommandResult.DENIED, str(refusal))

    def _answer_query(self, request: MavCommandRequest, now_s: float) -> CommandResult | None:
        """Answers queries, which need no control; None for other commands."""
        if request.command == SET_MESSAGE_INTERVAL and 0.0 < request.params[1] < 1e6 / FASTEST_HZ:
            raise Refused(f"no message is sent more often than {FASTEST_HZ:g} times a second")
        found = self._version.command(request)
        return found if found is not None else self._streams.command(request, now_s)

    def _act(self, request: MavCommandRequest, body: AnyBody, now_s: float) -> None:
        running = self._begin(request, now_s)

        def ended(reply: CiReply) -> None:
            if running.is_cancelled:
                return
            match reply.outcome:
                case Outcome.ACCEPTED:
                    self._end(running, CommandResult.ACCEPTED, "")
                case Outcome.REFUSED:
                    self._end(running, CommandResult.DENIED, _with_first_line(reply))
                case _:
                    self._end(running, CommandResult.FAILED, reply.reason)

        self._requesting.act(request.sender, body, ended)

    def _carry_out(self, request: MavCommandRequest) -> None:
        """Calls an added handler. Whoever is not in control is denied: MAVSDK 4.1's blocking calls crash on other words."""
        try:
            self._more[request.command](request)
        except Refused as refusal:
            self._refuse(request, CommandResult.DENIED, str(refusal))
        else:
            self._answer(request, CommandResult.ACCEPTED, "")

    def _begin(self, request: MavCommandRequest, now_s: float) -> _Running:
        running = _Running(request, now_s)
        self._running.append(running)
        return running

    def _end(self, running: _Running, result: CommandResult, reason: str) -> None:
        if running in self._running:
            self._running.remove(running)
        self._answer(running.request, result, reason)

    def _refuse(self, request: MavCommandRequest, result: CommandResult, reason: str) -> None:
        self._running = [running for running in self._running if running.request is not request]
        self._answer(request, result, reason)

    def _answer(self, request: MavCommandRequest, result: CommandResult, reason: str) -> None:
        if result is not CommandResult.ACCEPTED:
            self.refused += 1
            name = enum_name("MAV_CMD", request.command).removeprefix("MAV_CMD_")
            self._report(f"{name} of station {request.sender.system} refused: {reason}")
        self.server.answer(request, result, now_s=self._requesting.now_s())

    def _cancel(self, cancel: CommandCancel) -> None:
        """Cancels a command: a started mission is aborted; others cannot be cancelled."""
        sender = cancel.sender
        running = next(
            (one for one in self._running if (one.request.sender, one.request.command) == (sender, cancel.command)),
            None,
        )
        is_open = self._requesting.mission.state in _OPEN
        if cancel.command != MISSION_START or (running is None and not is_open):
            return

        def ended(reply: CiReply) -> None:
            if reply.outcome is not Outcome.ACCEPTED:
                self._report(f"the mission of station {sender.system} is not cancelled: {reply.reason}")
            elif running is not None:
                running.is_cancelled = True
                self._end(running, CommandResult.CANCELLED, "cancelled by its sender")
            else:
                self.cancels.cancelled(cancel)

        try:
            self._requesting.act(sender, Steer(verb=Verb.ABORT), ended)
        except Refused as refusal:
            self.refused += 1
            self._report(f"COMMAND_CANCEL of station {sender.system} refused: {refusal}")

    # --- what the commands mean ---

    def _start(self, request: MavCommandRequest) -> AnyBody:
        first, last = request.params[:2]
        if not _is_unset(first) or not (_is_unset(last) or last < 0.0):
            raise Refused("a mission starts as a whole: leave the first and last item at 0")
        is_paused = self._requesting.mission.state == ActionState.PAUSED
        return Steer(verb=Verb.RESUME if is_paused else Verb.START)

    def _pause_or_continue(self, request: MavCommandRequest) -> AnyBody:
        match request.params[0]:
            case 0.0:
                return Steer(verb=Verb.PAUSE)
            case 1.0:
                return Steer(verb=Verb.RESUME)
        raise Refused(f"{request.params[0]:g} is neither 0 (pause) nor 1 (continue)")

    def _abort(self, request: MavCommandRequest) -> AnyBody:
        if request.params[0] != 1.0:
            raise Refused(f"{request.params[0]:g} is not 1 (abort)")
        return Steer(verb=Verb.ABORT)

    def _return(self, request: MavCommandRequest) -> AnyBody:
        return RequestAction(capability="return_home", author=_author(request))

    def _land(self, request: MavCommandRequest) -> AnyBody:
        if not all(_is_unset(value) for value in request.params[4:6]):
            raise Refused("it lands where it is: leave the position at 0")
        return RequestAction(capability="land", author=_author(request))


_BODIES: Final[Mapping[int, Callable[[Commands, MavCommandRequest], AnyBody]]] = {
    20: Commands._return,
    21: Commands._land,
    193: Commands._pause_or_continue,
    MISSION_START: Commands._start,
    31010: Commands._abort,
}
HANDLED: Final = frozenset({*_BODIES, *STREAM_COMMANDS, REQUEST_AUTOPILOT_CAPABILITIES, REQUEST_OPERATOR_CONTROL})
"""Numbers of the commands that are carried out; others are answered as unsupported."""


def _author(request: MavCommandRequest) -> str:
    return f"station {request.sender.system}"


def _is_unset(value: Any) -> bool:
    return value == 0.0 or math.isnan(value)


def _with_first_line(reply: CiReply) -> str:
    more = reply.text.strip().partition("\n")[0]
    return f"{reply.reason}: {more}" if more else reply.reason
