"""Client of the command protocol: sends COMMAND_LONG and COMMAND_INT until a COMMAND_ACK reports the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.codec import enum_name
from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult

RETRY_S: Final = 0.5
ATTEMPTS: Final = 8
PROGRESS_S: Final = 5.0
"""Longest silence after an `IN_PROGRESS` answer, s."""


class CommandCall:
    """A command under way, and its result."""

    __slots__ = (
        "_message",
        "attempts",
        "command",
        "deadline_s",
        "is_in_progress",
        "progress",
        "result",
        "result_param1",
        "result_param2",
        "target",
    )

    def __init__(self, target: Address, command: int, message: MavlinkMessage) -> None:
        self.target = target
        self.command = command
        """MAV_CMD."""
        self.result: CommandResult | None = None
        """None while it is not over."""
        self.is_in_progress = False
        """Whether the other end has reported it as in progress."""
        self.progress: int | None = None
        """Percent; None while it is not reported."""
        self.result_param1 = 0
        """What the command defines it to be, as a reason; 0 while it is in progress."""
        self.result_param2 = 0
        """The same, behind it."""
        self.attempts = 0
        self.deadline_s = 0.0
        """When the patience of this attempt ends."""
        self._message = message

    def __repr__(self) -> str:
        result = "under way" if self.result is None else self.result.words
        return f"{enum_name('MAV_CMD', self.command)} to {self.target.system}/{self.target.component}: {result}"


class MavCommandClient(Microservice[CommandCall]):
    """Sends commands; a call is returned as an event when it ends, and on every progress report."""

    handles = frozenset({"COMMAND_ACK"})

    def __init__(self, own: Address, *, retry_s: float = RETRY_S, attempts: int = ATTEMPTS) -> None:
        super().__init__(own)
        self._retry_s = retry_s
        self._attempts = attempts
        self._calls: dict[tuple[Address, int], CommandCall] = {}

    def send_long(
        self,
        target: Address,
        command: int,
        params: Sequence[float] = (),
        *,
        now_s: float,
        is_repeatable: bool = True,
    ) -> CommandCall:
        """Sends a COMMAND_LONG.

        Args:
            target: the receiver; component 0 is any component that handles it.
            command: MAV_CMD.
            params: up to seven; those left out are 0.
            now_s: now.
            is_repeatable: whether it is sent again while its answer stays away; else it is waited for as long.

        Raises:
            Refused: this command to this target is still under way.
        """
        values = {f"param{index}": value for index, value in enumerate(params, start=1)}
        return self._begin(
            target,
            command,
            make(
                "COMMAND_LONG",
                command=command,
                target_system=target.system,
                target_component=target.component,
                **values,
            ),
            now_s,
            is_repeatable=is_repeatable,
        )

    def send_int(
        self,
        target: Address,
        command: int,
        params: Sequence[float] = (),
        *,
        frame: int,
        position: tuple[int, int, float] = (0, 0, 0.0),
        now_s: float,
    ) -> CommandCall:
        """Sends a COMMAND_INT, the form for positions.

        Args:
            target: the receiver.
            command: MAV_CMD.
            params: up to four; those left out are 0.
            frame: MAV_FRAME of the position.
            position: latitude and longitude in 1e-7 degrees, or local x and y in 1e-4 m; and the altitude in metres, as
                the frame defines.
            now_s: now.

        Raises:
            Refused: this command to this target is still under way.
        """
        values = {f"param{index}": value for index, value in enumerate(params, start=1)}
        x, y, z = position
        message = make(
            "COMMAND_INT",
            command=command,
            frame=frame,
            x=x,
            y=y,
            z=z,
            target_system=target.system,
            target_component=target.component,
            **values,
        )
        return self._begin(target, command, message, now_s)

    def abandon(self, call: CommandCall) -> None:
        """Stops repeating and waiting; the call is not returned as an event, and its kind can be sent again.

        A late answer is taken for one to the next command of the kind.
        """
        if self._calls.get((call.target, call.command)) is call:
            del self._calls[call.target, call.command]

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in an answer."""
        if not self._is_for_us(message):
            return
        call = self._calls.get((sender, message.command)) or self._calls.get(
            (Address(sender.system, 0), message.command)
        )
        if call is None:
            return
        call.result_param1 = 0 if message.result == CommandResult.IN_PROGRESS else message.progress
        call.result_param2 = message.result_param2
        if message.result == CommandResult.IN_PROGRESS:
            call.is_in_progress = True
            call.progress = None if message.progress == 255 else message.progress
            call.deadline_s = now_s + PROGRESS_S
            self._events.append(call)
        else:
            known = message.result in CommandResult._value2member_map_
            self._end(call, CommandResult(message.result) if known else CommandResult.OTHER)

    def tick(self, now_s: float) -> None:
        """Repeats commands, or gives up."""
        for call in [call for call in self._calls.values() if now_s >= call.deadline_s]:
            # a command in progress is not sent again: a peer that does not know repeats would run it twice
            if call.is_in_progress or call.attempts >= self._attempts:
                self._end(call, CommandResult.NO_ANSWER)
            else:
                self._attempt(call, now_s)

    def next_tick_s(self) -> float | None:
        """When the next patience ends."""
        return min((call.deadline_s for call in self._calls.values()), default=None)

    def _begin(
        self, target: Address, command: int, message: MavlinkMessage, now_s: float, *, is_repeatable: bool = True
    ) -> CommandCall:
        if (target, command) in self._calls:
            name = enum_name("MAV_CMD", command)
            raise Refused(f"{name} to {target.system}/{target.component} is still under way")
        call = self._calls[target, command] = CommandCall(target, command, message)
        self._attempt(call, now_s)
        if not is_repeatable:
            call.attempts = self._attempts
            call.deadline_s = now_s + self._attempts * self._retry_s
        return call

    def _attempt(self, call: CommandCall, now_s: float) -> None:
        message = call._message
        if call.attempts and message.name == "COMMAND_LONG":
            message = msgspec.structs.replace(message, confirmation=min(call.attempts, 255))
        call.attempts += 1
        call.deadline_s = now_s + self._retry_s
        self._outgoing.append(message)

    def _end(self, call: CommandCall, result: CommandResult) -> None:
        del self._calls[call.target, call.command]
        call.result = result
        self._events.append(call)
