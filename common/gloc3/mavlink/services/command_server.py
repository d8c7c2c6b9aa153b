"""Server of the command protocol: delivers each command once, however often it is sent, and keeps its answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Final

import msgspec

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.plan import units_per_degree

REMEMBERED_S: Final = 5.0
"""Time after the answer or the last repeat within which a COMMAND_LONG with a higher confirmation is a repeat, s.

Our client repeats for 4 s. Later it is the same command given again, whose first frame was lost.
"""
REPEATED_WITHIN_S: Final = 1.5
"""The same once its sender has given another command, s; and after the answer to a COMMAND_INT, which has no confirmation
and is never a repeat once its sender has given another command."""
DUPLICATED_WITHIN_S: Final = 0.25
"""Time within which the same COMMAND_LONG with the same confirmation or a lower one is a duplicate from the link, s."""
ONLY_QUERIES: Final = frozenset({510, 512, 519, 520})
"""Commands that only request a message: a repeat, however soon, means that it was not received."""
MOST_REMEMBERED: Final = 128
_NOT_SET: Final = 0x7FFF_FFFF


class MavCommandRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A received command."""

    sender: Address
    target: Address
    """As it was addressed; component 0 means anybody here."""
    command: int
    """MAV_CMD."""
    params: tuple[float, float, float, float, float, float, float]
    """As in COMMAND_LONG: 5 and 6 are degrees or metres for both message types; NaN where a COMMAND_INT has no
    value."""
    is_int: bool
    frame: int
    """MAV_FRAME of a COMMAND_INT; 0 for a COMMAND_LONG."""
    confirmation: int


def serve_all(_request: MavCommandRequest) -> bool:
    """Serves every command."""
    return True


class _Answered(msgspec.Struct):
    """What is kept of a command that ran or runs."""

    request: MavCommandRequest
    ack: MavlinkMessage | None
    """None while it runs and has not been acknowledged."""
    is_over: bool
    t_s: float
    """When it was answered or repeated last."""
    confirmation: int
    """Of the last copy."""


class MavCommandServer(Microservice[MavCommandRequest]):
    """Receives commands: each comes out as an event once, and is answered with `answer`.

    Args:
        own: as whom it answers.
        commands: those that are handled; others are answered as unsupported. None passes all on.
        is_autopilot: answers for the whole system also what it does not support; others keep silent about what is
            addressed to everybody and not theirs.
        serves: which commands are looked at; for others it is as if it were not there.
    """

    handles = frozenset({"COMMAND_LONG", "COMMAND_INT"})

    def __init__(
        self,
        own: Address,
        commands: Collection[int] | None = None,
        *,
        is_autopilot: bool = False,
        serves: Callable[[MavCommandRequest], bool] = serve_all,
    ) -> None:
        super().__init__(own)
        self._serves = serves
        self.repeated = 0
        """Requests that were repeats of others."""
        self._commands = commands
        self._is_autopilot = is_autopilot
        self._known: dict[tuple[Address, int], _Answered] = {}

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a command: a new one becomes an event, a repeat its answer."""
        if not self._is_for_us(message):
            return
        request = _read(message, sender)
        if not self._serves(request):
            return
        if self._commands is not None and request.command not in self._commands:
            if self._is_autopilot or request.target.component == self.own.component:
                self._acknowledge(request, CommandResult.UNSUPPORTED)
            return
        key = (sender, request.command)
        known = self._known.get(key)
        if known is not None and self._is_repeat(known, request, now_s):
            self.repeated += 1
            if request.confirmation > known.confirmation:
                known.confirmation, known.t_s = request.confirmation, now_s
            if known.ack is None:
                self._acknowledge(request, CommandResult.IN_PROGRESS)
            else:
                self._outgoing.append(known.ack)
            return
        if any(running.request.command == request.command for running in self._known.values() if not running.is_over):
            self._acknowledge(request, CommandResult.TEMPORARILY_REJECTED)
            return
        self._known.pop(key, None)
        if len(self._known) >= MOST_REMEMBERED:
            self._drop_finished()
        self._known[key] = _Answered(request, None, False, now_s, request.confirmation)
        self._events.append(request)

    def answer(
        self,
        request: MavCommandRequest,
        result: CommandResult,
        *,
        now_s: float,
        progress: int = 255,
        result_param1: int = 0,
        result_param2: int = 0,
    ) -> None:
        """Answers a command, or reports its progress with `IN_PROGRESS`; any other result is final.

        Args:
            request: the event.
            result: the result.
            now_s: now.
            progress: percent, 255 for unknown.
            result_param1: of the final answer, as the command defines it.
            result_param2: the same.
        """
        param1 = progress if result is CommandResult.IN_PROGRESS else result_param1
        ack = self._acknowledge(request, result, param1, result_param2)
        known = self._known.get((request.sender, request.command))
        if known is not None and known.request is request:
            known.ack, known.is_over, known.t_s = ack, result is not CommandResult.IN_PROGRESS, now_s

    def _is_repeat(self, known: _Answered, request: MavCommandRequest, now_s: float) -> bool:
        before = known.request
        if request.command in ONLY_QUERIES:
            return False
        if request.is_int != before.is_int or request.frame != before.frame or not _same(request.params, before.params):
            return False
        age_s = now_s - known.t_s
        if not known.is_over:
            return True
        if request.is_int:
            return age_s < REPEATED_WITHIN_S and self._is_latest(request)
        if request.confirmation > known.confirmation:
            return age_s < (REMEMBERED_S if self._is_latest(request) else REPEATED_WITHIN_S)
        return age_s < DUPLICATED_WITHIN_S

    def _is_latest(self, request: MavCommandRequest) -> bool:
        """Whether its sender has given no other command since, but queries."""
        given = (
            command
            for sender, command in reversed(self._known)
            if sender == request.sender and command not in ONLY_QUERIES
        )
        return next(given, None) == request.command

    def _drop_finished(self) -> None:
        over = [key for key, known in self._known.items() if known.is_over]
        for key in over[: MOST_REMEMBERED // 2] or list(self._known)[:1]:
            del self._known[key]

    def _acknowledge(
        self, request: MavCommandRequest, result: CommandResult, param1: int | None = None, result_param2: int = 0
    ) -> MavlinkMessage:
        ack = make(
            "COMMAND_ACK",
            command=request.command,
            result=result,
            progress=(255 if result is CommandResult.IN_PROGRESS else 0) if param1 is None else param1,
            result_param2=result_param2,
            target_system=request.sender.system,
            target_component=request.sender.component,
        )
        self._outgoing.append(ack)
        return ack


class CommandCancel(msgspec.Struct, frozen=True):
    """Somebody wants one of his commands, which is in progress, to end."""

    command: int
    """MAV_CMD."""
    sender: Address


class CancelServer(Microservice[CommandCancel]):
    """Receives COMMAND_CANCEL, which is answered with the acknowledgement of the command that it ends, or not at all."""

    handles = frozenset({"COMMAND_CANCEL"})

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a cancel request; a broadcast one is ignored."""
        if (message.target_system, message.target_component) == self.own:
            self._events.append(CommandCancel(message.command, sender))

    def cancelled(self, cancel: CommandCancel) -> None:
        """Reports that an action ended by cancellation, after the command that had begun it was answered."""
        self._send_to(cancel.sender, "COMMAND_ACK", command=cancel.command, result=CommandResult.CANCELLED)


def _same(left: Sequence[float], right: Sequence[float]) -> bool:
    """Equal, where NaN equals NaN."""
    return all(a == b or (math.isnan(a) and math.isnan(b)) for a, b in zip(left, right, strict=True))


def _read(message: MavlinkMessage, sender: Address) -> MavCommandRequest:
    first = (message.param1, message.param2, message.param3, message.param4)
    is_int = message.name == "COMMAND_INT"
    if is_int:
        per_unit = units_per_degree(message.frame)
        x, y = (math.nan if value == _NOT_SET else value / per_unit for value in (message.x, message.y))
        z = message.z
    else:
        x, y, z = message.param5, message.param6, message.param7
    return MavCommandRequest(
        sender=sender,
        target=Address(message.target_system, message.target_component),
        command=message.command,
        params=(*first, x, y, z),
        is_int=is_int,
        frame=message.frame if is_int else 0,
        confirmation=0 if is_int else message.confirmation,
    )
