"""Manoeuvres in the autopilot's own modes, step by step: a pure state machine of the autopilot driver."""

from collections.abc import Sequence
from math import dist, exp, hypot
from typing import Annotated, Final, NamedTuple

from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import AutopilotState, FlightMode, LandedState, Manoeuvre, ManoeuvreKind, ManoeuvreState
from gloc3_onboard.sensors.devices import AutopilotBehaviour, CommandAnswer

COPTER: Final = AutopilotBehaviour()
SETTLING_M: Final = 1.0
"""Distance below the requested height at which the autopilot may end its climb, m (PX4: NAV_MC_ALT_RAD, 0.8 m)."""
HOME_M: Final = 160.0
"""So near home what circles in its return begins to land: two radii of PX4's circle (RTL_LOITER_RAD, NAV_LOITER_RAD)."""
UNSEEN_S: Final = 120.0
"""So long what shall come to rest is waited for where nobody knows how fast it is; then it counts as standing."""
RISING_M_S: Final = 1.0
"""Assumed rate of climb of what floats when it is asked to surface, until its velocity shows otherwise."""
GROUNDED_S: Final = 25.0
"""A vehicle that the autopilot has reported on the ground for so long in our landing, and that it has not disarmed, is
asked to disarm, s; ArduPilot's own delay is 20 s (LAND_DISARMDELAY)."""
ENDING_M: Final = 3.0
"""Distance from the last position of a plan at which the autopilot may end it, m (PX4: NAV_ACC_RAD, 2 m at most)."""


class DriverSettings(Settings, frozen=True):
    """Settings of the autopilot driver."""

    repeat_s: Annotated[float, Bounds(0.1, 10.0)] = 1.0
    """A mode that the autopilot has not taken is commanded again after this time."""
    step_timeout_s: Annotated[float, Bounds(0.5, 60.0)] = 8.0
    """A step of a manoeuvre (mode, arming, take-off) fails after this time."""
    at_rest_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.15
    """Speed below which a vehicle counts as standing, in m/s, and may be disarmed at the end of its path."""
    at_rest_over_s: Annotated[float, Bounds(0.0, 60.0)] = 0.0
    """So long its velocity is averaged for that: waves move what stays where it is to and fro."""


class SetMode(NamedTuple):
    """Ask for a mode."""

    mode: FlightMode

    @property
    def words(self) -> str:
        """For a person."""
        return f"enter mode {self.mode}"


class Arm(NamedTuple):
    """Ask to arm."""

    words: str = "arm"


class Settle(NamedTuple):
    """Command nothing; wait for the landing of a vehicle that does not disarm automatically."""

    words: str = "come to rest"


class ComeHome(NamedTuple):
    """Ask for nothing; wait until the autopilot's return has come near home."""

    words: str = "come home"


class Disarm(NamedTuple):
    """Disarm: after a failed start on the ground, and for vehicles that do not disarm automatically."""

    words: str = "disarm"


class Climb(NamedTuple):
    """Ask to take off."""

    height_m: float
    words: str = "take off"


class StartMission(NamedTuple):
    """Ask an armed vehicle on the ground to begin its mission."""

    words: str = "begin its mission"


AutopilotCommand = SetMode | Arm | Disarm | Climb | StartMission
ManoeuvreStep = AutopilotCommand | Settle | ComeHome


class ManoeuvreMachine:
    """Carries one manoeuvre through its steps: from the autopilot's state and answers to the next commands.

    Args:
        settings: time-outs.
    """

    def __init__(self, settings: DriverSettings) -> None:
        self.action_id = ""
        self.kind: ManoeuvreKind | None = None
        self.state: ManoeuvreState | None = None
        self.reason = ""
        self.ticket = 0
        """Ticket of the command under way; set by the driver after the write."""
        self._settings = settings
        self._steps: list[ManoeuvreStep] = []
        self._behaviour = AutopilotBehaviour()
        self._since_s = 0.0
        self._is_requested = False
        self._has_armed = False
        self._height_m = 0.0
        self._end_ned_m: Vector3 | None = None
        self._comes_down = False
        self._grounded_since_s: float | None = None
        """Since when it has been armed on the ground in our landing."""
        self.away_m: float | None = None
        """Distance from home over ground, as the driver keeps it; None where it is not known."""

    @property
    def is_running(self) -> bool:
        """Whether the autopilot flies, or is about to fly, our manoeuvre."""
        return self.state is ManoeuvreState.RUNNING

    @property
    def is_climbing(self) -> bool:
        """Whether a take-off has completed its last step; the owner's setpoints may end it from now on."""
        return self.is_running and self.kind is ManoeuvreKind.TAKE_OFF and not self._steps

    def lands_for(self, action_id: str) -> bool:
        """Whether a landing is under way that was asked for under this id."""
        return self.is_running and self.kind is ManoeuvreKind.LAND and self.action_id == action_id

    @property
    def is_taking_over(self) -> bool:
        """Whether a mode that ends the owner's setpoints is requested, but not confirmed yet."""
        return self.is_running and bool(self._steps) and isinstance(self._steps[0], SetMode)

    def begin(
        self,
        manoeuvre: Manoeuvre,
        now_s: float,
        behaviour: AutopilotBehaviour = COPTER,
        away_m: float | None = None,
    ) -> None:
        """Takes a manoeuvre up, in place of the one before.

        Args:
            manoeuvre: what is asked for.
            now_s: the time.
            behaviour: of the autopilot that shall fly it.
            away_m: distance from home over ground; None where that is not known.
        """
        self.away_m = away_m
        if manoeuvre.kind is not ManoeuvreKind.LAND or manoeuvre.action_id != self.action_id:
            self._grounded_since_s = None
        self.action_id, self.kind = manoeuvre.action_id, manoeuvre.kind
        self.state, self.reason, self.ticket = ManoeuvreState.RUNNING, "", 0
        self._since_s, self._is_requested, self._has_armed = now_s, False, False
        self._height_m, self._behaviour, self._end_ned_m = manoeuvre.height_m, behaviour, manoeuvre.end_ned_m
        self._comes_down = manoeuvre.comes_down
        match manoeuvre.kind:
            case ManoeuvreKind.TAKE_OFF | ManoeuvreKind.SET_OFF:
                self._steps = [SetMode(behaviour.arm_in_mode)] if behaviour.arm_in_mode else []
                self._steps += [Arm()] if manoeuvre.may_arm else []
                self._steps += [Climb(manoeuvre.height_m)] if manoeuvre.kind is ManoeuvreKind.TAKE_OFF else []
                self._refuse_what_it_cannot(behaviour)
            case ManoeuvreKind.LAND:
                is_far = behaviour.returns_to_land and away_m is not None and away_m > HOME_M
                self._steps = [SetMode(FlightMode.RETURN), ComeHome()] if is_far else []
                self._steps += [SetMode(behaviour.land_mode)]
                self._steps += [] if behaviour.disarms_itself else [Settle(), Disarm()]
            case ManoeuvreKind.HOLD:
                self._steps = [SetMode(FlightMode.HOLD)]
            case ManoeuvreKind.PLAN:
                self._steps = [SetMode(FlightMode.MISSION)]
                self._steps += [Arm()] if manoeuvre.may_arm else []
                if manoeuvre.may_arm and behaviour.arm_in_mode is FlightMode.GUIDED:  # it does not arm in its mission
                    self._steps = [SetMode(FlightMode.GUIDED), Arm(), SetMode(FlightMode.MISSION), StartMission()]

    def _refuse_what_it_cannot(self, behaviour: AutopilotBehaviour) -> None:
        if self.kind is ManoeuvreKind.SET_OFF and behaviour.climbs:
            self._end(
                ManoeuvreState.FAILED, f"a {behaviour.vehicle} does not set off without climbing: ask for a take-off"
            )
        elif self.kind is ManoeuvreKind.TAKE_OFF and not behaviour.climbs:
            self._end(
                ManoeuvreState.FAILED, f"a {behaviour.vehicle} does not take off: its missions begin with drive_off"
            )

    def abandon(self, reason: str) -> None:
        """Ends a manoeuvre under way, because another party moves the vehicle now."""
        if self.is_running:
            self._end(ManoeuvreState.FAILED, reason)

    def finish(self) -> None:
        """Ends the climb; the owner's setpoints continue from it."""
        if self.is_climbing:
            self._end(ManoeuvreState.DONE, "")

    def repeat(self, now_s: float) -> None:
        """Repeats the step under way, whose requests were withheld so far."""
        self._is_requested, self._since_s = False, now_s

    def may_settle(self, climbed_m: float | None, position_ned_m: Vector3 | None = None) -> bool:
        """Whether the autopilot may change to hold at this climb and position (None: unknown)."""
        if self.kind is ManoeuvreKind.PLAN and self._end_ned_m is not None and position_ned_m is not None:
            return dist(position_ned_m, self._end_ned_m) <= ENDING_M
        return self.kind is ManoeuvreKind.TAKE_OFF and (climbed_m is None or climbed_m >= self._height_m - SETTLING_M)

    @property
    def comes_down(self) -> bool:
        """Whether the autopilot flies a plan that ends on the ground."""
        return self.is_running and self.kind is ManoeuvreKind.PLAN and self._comes_down

    def advance(
        self, now_s: float, autopilot: AutopilotState | None, answer: CommandAnswer | None, rested_s: float | None = 0.0
    ) -> Sequence[AutopilotCommand]:
        """Looks at what has become of the step under way; returns what to command next.

        While the autopilot's state is not known (None) only a landing or a hold is asked for, once, and its answer
        believed: a pilot who takes over unseen is not overruled.

        Args:
            now_s: the time.
            autopilot: its state, where that is known.
            answer: to the command under way.
            rested_s: for how long the vehicle has stood still; None where nobody knows how fast it is.
        """
        if not self.is_running:
            return ()
        if autopilot is None:
            return self._advance_unseen(now_s, answer)
        if self._is_left_armed(autopilot, now_s):
            return (Disarm(),)
        while self._steps and self._is_reached(self._steps[0], autopilot, answer, now_s, rested_s):
            self._has_armed |= isinstance(self._steps[0], Arm) and self._is_requested
            self._steps.pop(0)
            self._since_s, self._is_requested, self.ticket, answer = now_s, False, 0, None
        if not self._steps:
            if self._is_over(autopilot):
                self._end(ManoeuvreState.DONE, "")
            return ()
        if answer is not None and not answer.is_accepted:
            return self._fail(answer.reason, autopilot)
        step = self._steps[0]
        if isinstance(step, Settle | ComeHome):
            return ()
        if now_s - self._since_s > self._settings.step_timeout_s:
            return self._fail(f"the autopilot did not {step.words} in time", autopilot)
        if self._is_requested:
            return ()
        self._is_requested = True
        return (step,)

    def _advance_unseen(self, now_s: float, answer: CommandAnswer | None) -> Sequence[AutopilotCommand]:
        step = self._steps[0] if self._steps else None
        if not isinstance(step, SetMode) or self.kind not in (ManoeuvreKind.LAND, ManoeuvreKind.HOLD):
            return ()
        if answer is not None and answer.is_accepted:
            self._steps.pop(0)
        elif answer is not None:
            self._end(ManoeuvreState.FAILED, answer.reason)
        elif now_s - self._since_s > self._settings.step_timeout_s:
            self._end(ManoeuvreState.FAILED, f"the autopilot did not {step.words} in time")
        elif not self._is_requested:
            self._is_requested = True
            return (step,)
        return ()

    def _is_left_armed(self, autopilot: AutopilotState, now_s: float) -> bool:
        """Whether it has stood on the ground for long, armed; again after as long. In flight the autopilot refuses."""
        may_be = self.kind is ManoeuvreKind.LAND and self._behaviour.disarms_itself
        if not (may_be and autopilot.is_armed and autopilot.landed is LandedState.ON_GROUND):
            self._grounded_since_s = None
        elif self._grounded_since_s is None:
            self._grounded_since_s = now_s
        elif now_s - self._grounded_since_s >= GROUNDED_S:
            self._grounded_since_s = now_s
            return True
        return False

    def _is_reached(
        self,
        step: ManoeuvreStep,
        autopilot: AutopilotState,
        answer: CommandAnswer | None,
        now_s: float,
        rested_s: float | None,
    ) -> bool:
        match step:
            case SetMode(mode=mode) if self.kind is ManoeuvreKind.PLAN:
                # What was heard last may be older than a hold that was commanded since.
                return autopilot.mode is mode and answer is not None and answer.is_accepted
            case SetMode(mode=mode):
                is_landing = self.kind is ManoeuvreKind.LAND
                has_come_down = is_landing and self._behaviour.returns_to_land and not autopilot.is_armed
                return autopilot.mode is mode or self._has_landed_into(autopilot) or has_come_down
            case Arm():
                return autopilot.is_armed
            case ComeHome():
                return not autopilot.is_armed or (self.away_m is not None and self.away_m <= HOME_M)
            case Settle():
                rest_s = self._behaviour.at_rest_s
                waited_s = now_s - self._since_s
                rests = waited_s >= UNSEEN_S if rested_s is None else min(rested_s, waited_s) >= rest_s
                return rests or self._has_landed_into(autopilot) or not autopilot.is_armed
            case Disarm():
                return not autopilot.is_armed
            case _:
                is_up = autopilot.is_armed and autopilot.landed in (LandedState.TAKING_OFF, LandedState.IN_AIR)
                return is_up or (answer is not None and answer.is_accepted)

    def _has_landed_into(self, autopilot: AutopilotState) -> bool:
        return self.kind is ManoeuvreKind.LAND and autopilot.mode_name in self._behaviour.lands_into

    def _is_over(self, autopilot: AutopilotState) -> bool:
        if self.kind is ManoeuvreKind.LAND:
            return not autopilot.is_armed
        if self.kind is ManoeuvreKind.SET_OFF:
            return autopilot.is_armed
        return autopilot.mode is FlightMode.HOLD  # PX4 has climbed, or flown its plan; ArduPilot's owner ends it

    def _fail(self, reason: str, autopilot: AutopilotState) -> Sequence[AutopilotCommand]:
        """What we have armed for a take-off that does not come is not left with turning propellers.

        Without its return a vehicle lands where it is.
        """
        if ComeHome() in self._steps:
            self._steps = [step for step in self._steps if step not in (SetMode(FlightMode.RETURN), ComeHome())]
            self._since_s, self._is_requested, self.ticket = self._since_s + self._settings.step_timeout_s, False, 0
            return ()
        is_left_armed = self._has_armed and autopilot.is_armed and autopilot.landed is LandedState.ON_GROUND
        self._end(ManoeuvreState.FAILED, reason)
        return (Disarm(),) if is_left_armed else ()

    def _end(self, state: ManoeuvreState, reason: str) -> None:
        self.state, self.reason, self.ticket = state, reason, 0
        self._steps = []


class RestMeter:
    """Measures for how long a vehicle has stood still.

    Args:
        settings: the speed that counts as standing, and the time over which the velocity is averaged.
    """

    def __init__(self, settings: DriverSettings) -> None:
        self._settings = settings
        self._since_s: float | None = None
        self._seen_s = float("-inf")
        self._mean_ned_m_s: Vector3 = (0.0, 0.0, 0.0)

    def begin_to_rise(self) -> None:
        """Assumes that what floats rises, until its velocity shows otherwise."""
        self._since_s, self._mean_ned_m_s = None, (0.0, 0.0, -RISING_M_S)

    def update(self, velocity_ned_m_s: Vector3 | None, now_s: float, *, floats: bool) -> float | None:
        """Adds a velocity.

        Args:
            velocity_ned_m_s: None where it is not known.
            now_s: the time.
            floats: whether the vehicle rests at the surface, where only its rise counts: a current carries it on.

        Returns:
            For how long the vehicle has stood still, s; None where the velocity is not known.
        """
        if velocity_ned_m_s is not None:
            share = 1.0 - exp(-(now_s - self._seen_s) / max(self._settings.at_rest_over_s, 1e-6))
            north, east, down = (
                mean + share * (now - mean) for mean, now in zip(self._mean_ned_m_s, velocity_ned_m_s, strict=True)
            )
            self._mean_ned_m_s, self._seen_s = (north, east, down), now_s
        counts = self._mean_ned_m_s[2:] if floats else self._mean_ned_m_s
        if velocity_ned_m_s is None or hypot(*counts) > self._settings.at_rest_m_s:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        if velocity_ned_m_s is None:
            return None
        return 0.0 if self._since_s is None else now_s - self._since_s
