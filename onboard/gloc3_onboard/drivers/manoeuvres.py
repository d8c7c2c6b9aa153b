"""Manoeuvres that the autopilot flies in its own modes, step by step: a pure machine of the autopilot driver."""

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

from gloc3.settings import Bounds, Settings
from gloc3.vehicle import AutopilotState, FlightMode, Manoeuvre, ManoeuvreKind, ManoeuvreState
from gloc3_onboard.devices import Answer


class DriverSettings(Settings, frozen=True):
    """Settings of the autopilot driver."""

    repeat_s: Annotated[float, Bounds(0.1, 10.0)] = 1.0
    """A mode that the autopilot has not taken is commanded again after this time."""
    step_timeout_s: Annotated[float, Bounds(0.5, 60.0)] = 8.0
    """A step of a manoeuvre (mode, arming, take-off) fails after this time."""


class SetMode(NamedTuple):
    """Write: ask for a mode."""

    mode: FlightMode


class Arm(NamedTuple):
    """Write: ask to arm."""


class Climb(NamedTuple):
    """Write: ask to take off."""

    height_m: float


Write = Any
"""A `SetMode`, `Arm`, `Climb` or setpoint to send."""


class ManoeuvreMachine:
    """Carries one manoeuvre through its steps: told the autopilot's state and answers, says what to command.

    Args:
        settings: time-outs.
    """

    def __init__(self, settings: DriverSettings) -> None:
        self.action_id = ""
        self.kind: ManoeuvreKind | None = None
        self.state: ManoeuvreState | None = None
        self.reason = ""
        self.ticket = 0
        """Of the command under way; set by the driver when it is written."""
        self._settings = settings
        self._steps: list[Write] = []
        self._since_s = 0.0
        self._is_asked = False

    @property
    def is_under_way(self) -> bool:
        """Whether the autopilot is flying, or about to fly, a manoeuvre of ours."""
        return self.state is ManoeuvreState.RUNNING

    def begin(self, manoeuvre: Manoeuvre, arm_in_mode: FlightMode | None, now_s: float) -> None:
        """Takes a manoeuvre up, in place of the one before.

        Args:
            manoeuvre: what is wanted.
            arm_in_mode: the mode in which this style of autopilot wants to be armed; None for any.
            now_s: now.
        """
        self.action_id, self.kind = manoeuvre.action_id, manoeuvre.kind
        self.state, self.reason, self.ticket = ManoeuvreState.RUNNING, "", 0
        self._since_s, self._is_asked = now_s, False
        match manoeuvre.kind:
            case ManoeuvreKind.TAKE_OFF:
                self._steps = [SetMode(arm_in_mode)] if arm_in_mode else []
                self._steps += [Arm()] if manoeuvre.may_arm else []
                self._steps += [Climb(manoeuvre.height_m)]
            case ManoeuvreKind.LAND:
                self._steps = [SetMode(FlightMode.LAND)]
            case ManoeuvreKind.HOLD:
                self._steps = [SetMode(FlightMode.HOLD)]

    def abandon(self, reason: str) -> None:
        """Ends a manoeuvre that is under way, because somebody else moves the vehicle now."""
        if self.is_under_way:
            self._end(ManoeuvreState.FAILED if self._steps else ManoeuvreState.DONE, reason)

    def advance(self, now_s: float, autopilot: AutopilotState | None, answer: Answer | None) -> Sequence[Write]:
        """Looks at what has become of the step under way; returns what to command next."""
        if not self.is_under_way or autopilot is None:
            return ()
        while self._steps and self._is_reached(self._steps[0], autopilot, answer):
            self._steps.pop(0)
            self._since_s, self._is_asked, self.ticket, answer = now_s, False, 0, None
        if not self._steps:
            if self._is_over(autopilot):
                self._end(ManoeuvreState.DONE, "")
            return ()
        if answer is not None and not answer.is_accepted:
            self._end(ManoeuvreState.FAILED, answer.reason)
            return ()
        if now_s - self._since_s > self._settings.step_timeout_s:
            self._end(ManoeuvreState.FAILED, f"the autopilot did not {_words(self._steps[0])} in time")
            return ()
        if self._is_asked:
            return ()
        self._is_asked = True
        return (self._steps[0],)

    def _is_reached(self, step: Write, autopilot: AutopilotState, answer: Answer | None) -> bool:
        match step:
            case SetMode(mode=mode):
                return autopilot.mode is mode
            case Arm():
                return autopilot.is_armed
            case _:
                return answer is not None and answer.is_accepted

    def _is_over(self, autopilot: AutopilotState) -> bool:
        match self.kind:
            case ManoeuvreKind.LAND:
                return not autopilot.is_armed
            case ManoeuvreKind.HOLD:
                return autopilot.mode is FlightMode.HOLD
            case _:
                return autopilot.mode is FlightMode.HOLD  # PX4 has climbed; with ArduPilot the owner's setpoints end it

    def _end(self, state: ManoeuvreState, reason: str) -> None:
        self.state, self.reason, self.ticket = state, reason, 0
        self._steps = []


def _words(step: Write) -> str:
    match step:
        case SetMode(mode=mode):
            return f"enter mode {mode}"
        case Arm():
            return "arm"
        case _:
            return "take off"
