"""The vehicle as behaviours see it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import nan
from typing import NamedTuple

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.control.vtol_form import VtolState
from gloc3_sitl.autopilot.estimator.estimator import Estimator
from gloc3_sitl.autopilot.mission import MissionProgress, MissionState
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.plans import StoredPlans
from gloc3_sitl.autopilot.tuning import Tuning


class TouchdownDetector:
    """Land detector: landed after thrust, motion and setpoint agree for a while; in the air once it climbs."""

    __slots__ = ("_since_s", "is_landed", "landed_s")

    SETTLE_S = 0.5
    """How long the signs of touchdown must last."""
    CERTAIN_S = 3.0
    """Time without thrust and motion after which the vehicle counts as landed, whatever the range finder reads, s."""

    def __init__(self) -> None:
        self.is_landed = True
        self.landed_s = 0.0
        """When it last came to the ground."""
        self._since_s: float | None = None

    def update(
        self,
        now_s: float,
        *,
        is_armed: bool,
        wants_down: bool,
        wants_up: bool,
        thrust_share: float,
        speed_down_m_s: float,
        height_m: float,
    ) -> None:
        """Updates from the state, at 50 Hz.

        Args:
            now_s: the time.
            is_armed: motors are on.
            wants_down: the setpoint is a descent (or absent).
            wants_up: the setpoint is a climb.
            thrust_share: collective thrust over that of hover.
            speed_down_m_s: estimated vertical speed.
            height_m: height over ground from the range finder, NaN if unknown.
        """
        if not is_armed:
            self._become(True, now_s)
            self._since_s = None
            return
        if self.is_landed:
            if wants_up and thrust_share > 0.9 and (speed_down_m_s < -0.15 or height_m > 0.3):
                self._become(False, now_s)
            return
        is_down = wants_down and thrust_share < 0.6 and abs(speed_down_m_s) < 0.25
        if not is_down:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s >= (self.CERTAIN_S if height_m > 0.5 else self.SETTLE_S):
            self._become(True, now_s)
            self._since_s = None

    def _become(self, is_landed: bool, now_s: float) -> None:
        if is_landed and not self.is_landed:
            self.landed_s = now_s
        self.is_landed = is_landed


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
