"""AD: servos, grippers, relays and winches, by name, on the autopilot or on the computer's pins."""

from collections import deque
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, ClassVar, Final

import msgspec

from gloc3.component.action import ActionPerformer
from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Gloc3Error, Refused, nearest
from gloc3.mission.model.payload import Grip, RunWinch, SetServo, SwitchOutput
from gloc3.mission.model.states import ActionState
from gloc3_onboard.payload.outputs import (
    GripperWrite,
    OutputDevice,
    OutputWrite,
    RelayWrite,
    ServoWrite,
    WinchWrite,
)

PayloadArguments = SetServo | Grip | SwitchOutput | RunWinch
ANSWER_S: Final = 10.0
"""Time after which a command without an answer has failed; the autopilot's protocol gives up before."""


class OutputKind(StrEnum):
    """Kinds of outputs."""

    SERVO = "servo"
    GRIPPER = "gripper"
    RELAY = "relay"
    """Whatever is on or off: a lamp, a pump, a magnet."""
    WINCH = "winch"


class OutputSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One output."""

    kind: OutputKind
    number: Annotated[int, msgspec.Meta(ge=0, le=512)]
    """Of the autopilot: output of a servo, instance of a gripper or winch from 1, of a relay from 0. Of the computer:
    line or channel."""
    chip: str = ""
    """Of the computer: GPIO chip or PWM chip, such as /dev/gpiochip4; empty for the first."""
    min_us: Annotated[float, msgspec.Meta(ge=500.0, le=2500.0)] = 1000.0
    """Pulse of a servo at a share of 0, us; it may be the longer one."""
    max_us: Annotated[float, msgspec.Meta(ge=500.0, le=2500.0)] = 2000.0
    """Pulse at a share of 1, us."""
    safe: bool | float | None = None
    """State when this component stops, goes quiet or fails: a relay's (false is off), or a servo's share; None to leave
    it. A winch that runs is stopped in any case, and a gripper is left."""


class PayloadSettings(Settings, frozen=True):
    """Settings of the driver."""

    outputs: dict[str, OutputSettings] = {}
    """The outputs by the names that missions use."""
    settle_s: Annotated[float, Bounds(0.0, 60.0)] = 0.5
    """Time that a servo or gripper is given to move after its command is accepted, s."""


class PayloadDriver(ActionPerformer, ActuatorDriver[PayloadSettings]):
    """Performs `set_servo`, `grip`, `switch` and `winch`, one at a time; two outputs at once need two components.

    An action is done when the device has accepted the command and the motion has had its time: autopilots do not report
    that a servo has arrived. A refusal or a missing answer fails the action with the reason.
    """

    performs: ClassVar = {"set_servo": SetServo, "grip": Grip, "switch": SwitchOutput, "winch": RunWinch}
    loggable = ("commands", "failures", "latest")

    def __init__(self, device: OutputDevice) -> None:
        self.commands = self.failures = 0
        self.latest = ""
        """The output commanded last."""
        self._device = device
        self._used: dict[str, OutputWrite] = {}
        """The last write to each output."""
        self._clear()

    def _clear(self) -> None:
        self._resets: deque[tuple[str, OutputWrite]] = deque()
        """Commands that undo actions that have ended; sent before those of the next action."""
        self._ticket: int | None = None
        self._sent_s: float | None = None
        """When the command under way was sent; None without one."""
        self._sent_for: PayloadArguments | None = None
        """The action of the command under way; None if it undoes one that has ended."""
        self._clear_action()

    def _clear_action(self) -> None:
        self._order: PayloadArguments | None = None
        self._writes: deque[tuple[str, OutputWrite]] = deque()
        self._is_begun = False
        """Whether a command of the action was sent."""
        self._moved_s = self._duration_s = 0.0
        self._seen_s = 0.0
        self._is_moving = False
        self._undo: OutputWrite | None = None
        """What ends the effect of the action."""

    # --- actions ---

    def begin_action(self, capability: str, arguments: PayloadArguments, now_s: float) -> None:
        """Prepares the command.

        Raises:
            Refused: there is no such output, or a value is out of its bounds.
        """
        name, kind = _output_of(arguments)
        write, undo, duration_s = self._planned(arguments, self._output(name, kind), self.earlier_progress)
        self._clear_action()
        self._order, self._undo, self._duration_s = arguments, undo, duration_s
        self._moved_s, self._seen_s = self.earlier_progress * duration_s, now_s
        self._writes.append((name, write))

    def pause_action(self, now_s: float) -> None:
        """Stops a winch; other outputs stay as they are."""
        if isinstance(self._order, RunWinch) and self._undo is not None:
            self._writes.append((self._order.winch, self._undo))

    def resume_action(self, now_s: float) -> None:
        """Runs the rest."""
        self._seen_s = now_s
        if isinstance(self._order, RunWinch):
            share = self._moved_s / self._duration_s
            output = self._output(self._order.winch, OutputKind.WINCH)
            self._is_moving = False
            self._writes.append((self._order.winch, self._planned(self._order, output, share)[0]))

    def end_action(self, now_s: float) -> None:
        """Undoes what must not outlast an action that was ended early; commands that were not sent are dropped."""
        if self._order is not None and self._undo is not None and self._is_begun:
            self._resets.append((_output_of(self._order)[0], self._undo))
        self._clear_action()

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()
        self._clear()

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Sends one command after the other and follows its answer."""
        results: list[Result] = []
        if self._sent_s is not None:
            self._follow(now_s)
        if self._sent_s is None and (self._resets or self._writes):
            results.append(Actuation(self._next_write(now_s)))
        elif self._sent_s is None and self._is_moving and self.is_running:
            self._move(now_s)
        return [*results, *self.action_reports(now_s)]

    def _next_write(self, now_s: float) -> OutputWrite:
        if self._resets:
            self._sent_for = None
            name, write = self._resets.popleft()
        else:
            self._sent_for, self._is_begun = self._order, True
            name, write = self._writes.popleft()
        self._sent_s, self.latest, self._used[name] = now_s, name, write
        return write

    def _follow(self, now_s: float) -> None:
        assert self._sent_s is not None
        answer = self._device.answer(self._ticket) if self._ticket is not None else None
        if answer is None and now_s - self._sent_s < ANSWER_S:
            return
        reason = answer.reason if answer is not None else f"no answer within {ANSWER_S:g} s"
        if self._ticket is None:
            reason = "this component is quiet and withholds commands"
        self._sent_s = self._ticket = None
        if answer is not None and answer.is_accepted:
            self._is_moving, self._seen_s = self._is_own(self._sent_for), now_s
            return
        self.failures += 1
        if self._sent_for is None:
            raise Gloc3Error(f"{self.latest} could not be reset after its action: {reason}")
        if self._is_own(self._sent_for):
            if self._used.get(self.latest) != self._undo:  # else it is tried once more
                self._undo = None
            self.advance(now_s, self._progress, ActionState.FAILED, f"{self.latest}: {reason}")

    def _is_own(self, order: PayloadArguments | None) -> bool:
        """Whether a command belongs to the action under way, not to one that has ended."""
        return order is not None and order is self._order

    def _move(self, now_s: float) -> None:
        """Counts the time that a motion takes; then the action is done, or its effect is undone first."""
        self._moved_s += now_s - self._seen_s
        self._seen_s = now_s
        if self._moved_s < self._duration_s:
            self.advance(now_s, self._progress)
            return
        order, undo = self._order, self._undo
        if isinstance(order, SwitchOutput) and undo is not None and self._used.get(order.output) != undo:
            self._writes.append((order.output, undo))
            self._is_moving = False
            return
        self._undo = None
        self._is_moving = False
        self.advance(now_s, 1.0, ActionState.DONE)

    @property
    def _progress(self) -> float:
        return min(self._moved_s / self._duration_s, 1.0) if self._duration_s > 0.0 else 0.0

    # --- outputs ---

    def _output(self, name: str, kind: OutputKind) -> OutputSettings:
        outputs = self.settings.outputs
        output = outputs.get(name)
        if output is None or output.kind is not kind:
            known = sorted(other for other, settings in outputs.items() if settings.kind is kind)
            hint = nearest(name, known) if known else f"it has no {kind}"
            raise Refused(f"there is no {kind} {name!r}; {hint}")
        return output

    def _planned(
        self, arguments: PayloadArguments, output: OutputSettings, share: float
    ) -> tuple[OutputWrite, OutputWrite | None, float]:
        """The command, what ends its effect, and its duration; a winch runs what is left of its length."""
        match arguments:
            case SetServo(servo=name, share=wanted, pulse_us=pulse_us):
                low, high = sorted((output.min_us, output.max_us))
                if pulse_us is None:
                    pulse_us = output.min_us + (wanted or 0.0) * (output.max_us - output.min_us)
                if not low <= pulse_us <= high:
                    raise Refused(f"servo {name}: {pulse_us:g} us is outside {low:g} to {high:g} us")
                return ServoWrite(output.number, pulse_us, output.chip), None, self.settings.settle_s
            case Grip(action=action):
                return GripperWrite(output.number, action == "grab"), None, self.settings.settle_s
            case SwitchOutput(is_on=is_on, for_s=for_s):
                write = RelayWrite(output.number, is_on, output.chip)
                return write, write._replace(is_on=not is_on) if for_s else None, for_s or 0.0
            case RunWinch(length_m=length_m, speed_m_s=speed_m_s):
                run = WinchWrite(output.number, length_m * (1.0 - share), speed_m_s)
                return run, WinchWrite(output.number, 0.0, 0.0), abs(length_m) / speed_m_s

    def actuate(self, write: OutputWrite) -> None:
        """Sends a command."""
        self.commands += 1
        self._ticket = self._device.send_output(write)

    def make_safe(self) -> None:
        """Undoes actions that have ended, brings what this component has moved into its safe state, and stops a winch."""
        for _, reset in self._resets:
            self._device.send_output(reset)
        self._resets.clear()
        for name, last in self._used.items():
            output = self.settings.outputs.get(name)
            safe = output.safe if output is not None else None
            if isinstance(last, WinchWrite) and last.length_m:
                self._device.send_output(WinchWrite(last.number, 0.0, 0.0))
            elif isinstance(last, RelayWrite) and safe is not None:
                self._device.send_output(last._replace(is_on=bool(safe)))
            elif isinstance(last, ServoWrite) and output is not None and safe is not None:
                pulse_us = output.min_us + float(safe) * (output.max_us - output.min_us)
                self._device.send_output(last._replace(pulse_us=pulse_us))
        self._used.clear()


def _output_of(arguments: PayloadArguments) -> tuple[str, OutputKind]:
    """The output of an action, and its kind."""
    match arguments:
        case SetServo(servo=name):
            return name, OutputKind.SERVO
        case Grip(gripper=name):
            return name, OutputKind.GRIPPER
        case SwitchOutput(output=name):
            return name, OutputKind.RELAY
        case RunWinch(winch=name):
            return name, OutputKind.WINCH
