"""The vehicle as behaviours see it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, hypot, nan, radians
from typing import Final, NamedTuple

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, Quaternion, Vector3, rotate
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.control.vtol_form import VtolState
from gloc3_sitl.autopilot.estimator.estimator import Estimator
from gloc3_sitl.autopilot.mission import MissionProgress, MissionState
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.plans import StoredPlans
from gloc3_sitl.autopilot.tuning import Tuning

_DOWN: Final = (0.0, 0.0, 1.0)


class TouchdownSigns(NamedTuple):
    """What tells ground from air."""

    wants_down: bool
    """The setpoint is a descent (or absent)."""
    wants_up: bool
    """The setpoint is a climb."""
    thrust_share: float
    """Collective thrust over that of hover."""
    is_idle: bool
    """The thrust is the least one, and the vehicle does not turn."""
    speed_down_m_s: float
    """Estimated vertical speed."""
    is_climb_known: bool
    """No height contradicts it."""
    height_m: float
    """Height over ground from the range finder, NaN if unknown."""


class TouchdownDetector:
    """Land detector: landed after thrust, motion and setpoint agree for a while; in the air once it climbs."""

    __slots__ = ("_since_s", "is_landed", "landed_s")

    SETTLE_S = 0.5
    """How long the signs of touchdown must last."""
    CERTAIN_S = 3.0
    """Time without thrust and motion after which the vehicle counts as landed, whatever the range finder reads, s."""
    IDLE_M_S = 1.0
    """What does not fall faster than this at the least thrust stands on something, m/s."""
    UNSEEN_S = 8.0
    """Time at the least thrust, without turning, after which it counts as landed where its climb is not known (PX4)."""

    def __init__(self) -> None:
        self.is_landed = True
        self.landed_s = 0.0
        """When it last came to the ground."""
        self._since_s: float | None = None

    def update(self, now_s: float, signs: TouchdownSigns, *, is_armed: bool) -> None:
        """Updates from the state, at 50 Hz.

        Args:
            now_s: the time.
            signs: of ground and air.
            is_armed: motors are on.
        """
        if not is_armed:
            self._become(True, now_s)
            self._since_s = None
            return
        if self.is_landed:
            climbs = signs.speed_down_m_s < -0.15 or signs.height_m > 0.3
            if signs.wants_up and signs.thrust_share > 0.9 and climbs:
                self._become(False, now_s)
            return
        if signs.is_climb_known:
            is_still = abs(signs.speed_down_m_s) < 0.25
            is_down = signs.thrust_share < 0.6 and (
                is_still or (signs.is_idle and abs(signs.speed_down_m_s) < self.IDLE_M_S)
            )
            lasts_s = self.CERTAIN_S if signs.height_m > 0.5 or not is_still else self.SETTLE_S
        else:
            is_down, lasts_s = signs.is_idle, self.UNSEEN_S
        if not (signs.wants_down and is_down):
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s >= lasts_s:
            self._become(True, now_s)
            self._since_s = None

    def _become(self, is_landed: bool, now_s: float) -> None:
        if is_landed and not self.is_landed:
            self.landed_s = now_s
        self.is_landed = is_landed


class CrashDetector:
    """Copter's crash check: it leans elsewhere than it is steered, and goes nowhere (`crash_check.cpp`)."""

    __slots__ = ("_acceleration_ned_m_s2", "_since_s", "has_crashed")

    OFF_RAD = radians(30.0)
    """Angle between the thrust and the one that is steered to …"""
    LEANS_RAD = radians(15.0)
    """… and between the thrust and the vertical."""
    MOVES_M_S2, MOVES_M_S = 3.0, 10.0
    """What accelerates or flies like this still falls."""
    LASTS_S = 2.0
    SHARE = 0.11
    """Of each acceleration, at 50 Hz: a low-pass filter of 1 Hz."""

    def __init__(self) -> None:
        self.has_crashed = False
        self._since_s: float | None = None
        self._acceleration_ned_m_s2: Vector3 = (0.0, 0.0, 0.0)

    def update(self, now_s: float, estimator: Estimator, wanted: Quaternion, *, is_flying: bool) -> None:
        """Updates from the state, at 50 Hz.

        Args:
            now_s: the time.
            estimator: attitude, velocity and acceleration.
            wanted: the attitude that is steered to, `ned_from_frd`.
            is_flying: armed, and not on the ground.
        """
        smoothed, newest = self._acceleration_ned_m_s2, estimator.inertial.acceleration_ned_m_s2
        north, east, down = (old + self.SHARE * (new - old) for old, new in zip(smoothed, newest, strict=True))
        self._acceleration_ned_m_s2 = (north, east, down)
        if not (is_flying and self._lies(estimator, wanted)):
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        self.has_crashed = self._since_s is not None and now_s - self._since_s >= self.LASTS_S

    def _lies(self, estimator: Estimator, wanted: Quaternion) -> bool:
        inertial = estimator.inertial
        axis, steered = rotate(inertial.ned_from_frd, _DOWN), rotate(wanted, _DOWN)
        return (
            axis[2] < cos(self.LEANS_RAD)
            and sum(is_one * to_be for is_one, to_be in zip(axis, steered, strict=True)) < cos(self.OFF_RAD)
            and hypot(*self._acceleration_ned_m_s2) < self.MOVES_M_S2
            and hypot(*inertial.velocity_ned_m_s) < self.MOVES_M_S
        )


class FlightDetector:
    """Whether a plane flies, as Plane judges it: it moves through the air or over ground, low-passed over seconds."""

    __slots__ = ("_likely",)

    SHARE = 0.016
    """Of each look, at 50 Hz: what does not move any more counts as standing after 2.8 s."""
    LIKELY = 0.1

    def __init__(self) -> None:
        self._likely = 0.0

    def update(self, *, is_armed: bool, moves_in_air: bool, moves_over_ground: bool) -> None:
        """Updates from air speed and satellites, at 50 Hz; without motors both have to show it."""
        moves = moves_in_air or moves_over_ground if is_armed else moves_in_air and moves_over_ground
        self._likely += self.SHARE * (moves - self._likely)

    @property
    def is_flying(self) -> bool:
        """Whether it probably flies."""
        return self._likely >= self.LIKELY


Report = Callable[[Severity, str], None]
"""Tells the ground a sentence."""


class HomePosition(NamedTuple):
    """Home: where the vehicle was armed, or where it was set."""

    place: GeoPoint
    position_ned_m: Vector3
    yaw_rad: float


@dataclass(slots=True)
class ReceivedSetpoint:
    """The newest setpoint from outside, and when it came."""

    setpoint: MotionSetpoint | AttitudeSetpoint | None = None
    received_s: float = -1e9
    period_s: float = 1e9
    """Smoothed time between setpoints."""
    since_s: float = -1e9
    """First setpoint of the stream: the one after the last gap of more than 1 s."""

    def put(self, setpoint: MotionSetpoint | AttitudeSetpoint, now_s: float) -> None:
        """A new setpoint."""
        gap = now_s - self.received_s
        self.period_s = gap if gap > 1.0 or self.period_s > 1.0 else 0.8 * self.period_s + 0.2 * gap
        if gap > 1.0:
            self.since_s = now_s
        self.setpoint = setpoint
        self.received_s = now_s

    def is_fresh(self, now_s: float, timeout_s: float) -> bool:
        """Whether the newest one is within a maximum age."""
        return now_s - self.received_s <= timeout_s

    def is_streaming(self, now_s: float, least_hz: float) -> bool:
        """Whether setpoints come in at this rate at least."""
        if least_hz <= 0.0:
            return True
        period = 1.0 / least_hz
        return now_s - self.received_s <= period and self.period_s <= period


class FollowTarget(NamedTuple):
    """Last reported state of the target to follow."""

    t_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3


@dataclass(slots=True)
class Craft:
    """The vehicle: estimate, tuning, plans, home and time."""

    estimator: Estimator
    tuning: Tuning
    pilot: Pilot
    plans: StoredPlans
    send_text: Report
    touchdown: TouchdownDetector = field(default_factory=TouchdownDetector)
    stream: ReceivedSetpoint = field(default_factory=ReceivedSetpoint)
    mission: MissionProgress = field(default_factory=MissionProgress)
    first_item: int = 0
    """Where missions begin: 1 where item 0 is home."""
    home: HomePosition | None = None
    now_s: float = 0.0
    is_armed: bool = False
    range_mount_m: float = 0.0
    """Height of the range finder over the ground when the vehicle stands, as in its readings, m."""
    airspeed_m_s: float = nan
    """By the pitot tube, where there is one."""
    crash: CrashDetector = field(default_factory=CrashDetector)
    """Only of multirotors."""
    flight: FlightDetector | None = None
    """Whether a plane flies; None for other vehicles."""
    vtol: VtolState | None = None
    """What a VTOL flies on; None for other vehicles."""
    is_leaking: bool = False
    """Whether there is water in the hull."""
    fault: str = ""
    """Description of a hardware fault, which blocks arming; empty for none."""
    has_operator_place: bool = False
    """Whether the Remote ID knows where the operator is."""
    last_setpoint: Setpoint = LANDED
    runway_rad: float = 0.0
    """Ground course of the latest take-off, for landings on wings."""
    is_facing: Vector3 | None = None
    """Position that the nose faces, if set."""
    track_points: list[Vector3] = field(default_factory=list)
    """Positions since arming, without loops, for a return along the track; recorded by driving vehicles."""
    records_track: bool = True
    """Not while it returns along them."""
    target: FollowTarget | None = None
    """Target to follow, if set."""

    def mission_left(self) -> None:
        """Mission mode was left before the end."""
        if self.mission.state is MissionState.ACTIVE:
            self.mission.state = MissionState.PAUSED

    @property
    def is_landed(self) -> bool:
        """On the ground."""
        return self.touchdown.is_landed

    @property
    def is_grounded(self) -> bool:
        """On the ground as far as others are told, and may disarm it: for a plane, too slow to fly, whatever its motor does."""
        return self.is_landed or (self.flight is not None and not self.flight.is_flying)

    @property
    def height_over_home_m(self) -> float:
        """Over home, or over the estimator's origin before there is a home."""
        down = 0.0 if self.home is None else self.home.position_ned_m[2]
        return down - self.estimator.inertial.position_ned_m[2]

    @property
    def height_over_ground_m(self) -> float:
        """By the range finder where it sees the ground, else over home."""
        estimator = self.estimator
        if self.now_s - estimator.range_t_s < 0.5:
            return estimator.ground_down_m - estimator.inertial.position_ned_m[2]
        return self.height_over_home_m
