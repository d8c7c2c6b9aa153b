"""CC: steers by hand: moves the vehicle as an operator's demands say, and keeps its place when they end."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from gloc3.component.action import ActionPerformer
from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import Vector3, wrap_pi, yaw_of
from gloc3.messages.standard_topics import POSE_LATE_S
from gloc3.messages.teleoperation import AT_REST, EXPIRES_S, TeleoperationState, Velocity, VelocityDemand
from gloc3.messages.vehicle import MotionLimits, Pose, Setpoint
from gloc3.mission.model.arguments import LONGEST_BY_HAND_S, Teleoperate
from gloc3.mission.model.states import ActionState

STEP_S: Final = 0.1
"""Longest time by which the target advances in one cycle, s."""
REPORT_S: Final = 0.2
STANDING_M_S: Final = 0.1
"""Speed demand below which a driven vehicle turns on the spot, m/s."""
ONLY_AHEAD: Final = "it only goes ahead and turns, not to the side, up or back"
_STILL: Final = (0.0, 0.0, 0.0)


class TeleoperateSettings(Settings, frozen=True):
    """Settings of steering by hand."""

    acceleration_m_s2: Annotated[float, Bounds(0.05, 20.0)] = 0.5
    """Acceleration of the velocity towards the demand, also to a stop, in m/s²."""
    lead_m: Annotated[float, Bounds(0.1, 10.0)] = 1.0
    """The place that is aimed at is no farther from the vehicle, so that one that is held fast does not leap when free."""
    turn_ahead_rad: Annotated[float, Bounds(0.05, 1.5)] = 0.35
    """The same for the heading."""
    is_driven: bool = False
    """The vehicle is led by heading and speed, as rovers and boats are: it goes ahead and turns, and neither to the side nor back."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""


class TeleoperateController(ActionPerformer, Controller[TeleoperateSettings]):
    """Performs `teleoperate`: a target that moves with the demanded velocity, and rests without one.

    The velocity is horizontal whatever the vehicle's roll and pitch, and turns with the target heading. A driven
    vehicle follows that velocity and heading until it stands, and then keeps its position.
    """

    loggable = ("taken", "expired")
    performs: ClassVar = {"teleoperate": Teleoperate}

    pose = Input(Pose)
    limits = Input(MotionLimits)
    motion_demand = Input(VelocityDemand)
    setpoint_wanted = Output(Setpoint, frame="ned")
    teleoperation = Output(TeleoperationState)

    def __init__(self) -> None:
        self._order = Teleoperate()
        self._ran_s = self._seen_s = self._began_s = 0.0
        self._place_ned_m: Vector3 | None = None
        self._velocity_ned_m_s: Vector3 = _STILL
        self._yaw_rad = 0.0
        self._resets = 0
        self._last: VelocityDemand | None = None
        """The demand that was taken last."""
        self._is_live = False
        self._last_report_s = -math.inf
        self.taken = self.expired = 0
        """Demands that were followed, and how often they ended."""

    def stop(self) -> None:
        """Forgets action and place."""
        self.drop_action()
        self._place_ned_m = None

    def begin_action(self, capability: str, arguments: Teleoperate, now_s: float) -> None:
        """Keeps the present place until a demand comes; those from before do not count."""
        self._order = arguments
        self._ran_s = self.earlier_progress * self._duration_s
        self._last = None
        self.resume_action(now_s)

    def resume_action(self, now_s: float) -> None:
        """Restarts from the present position."""
        self._seen_s = self._began_s = now_s
        self._place_ned_m, self._is_live, self._last_report_s = None, False, -math.inf

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Moves the target while the action runs."""
        results: list[Result] = []
        if self.is_running:
            results = self._lead(now_s, inbox)
            self._ran_s += now_s - self._seen_s
            self._seen_s = now_s
            duration_s = self._duration_s
            is_over = self._ran_s >= duration_s
            progress = self._ran_s / duration_s if duration_s else 1.0
            self.advance(now_s, progress, ActionState.DONE if is_over else ActionState.RUNNING)
        return [*results, *self.action_reports(now_s)]

    @property
    def _duration_s(self) -> float:
        return LONGEST_BY_HAND_S if self._order.duration_s is None else self._order.duration_s

    def _lead(self, now_s: float, inbox: Inbox) -> list[Result]:
        pose = inbox.latest(self.pose)
        if pose is None or not pose.payload.is_valid or now_s - pose.t_s > self.settings.pose_limit_s:
            self._place_ned_m = None
            return []
        at, limits = pose.payload, inbox.latest(self.limits)
        if self._place_ned_m is None or at.reset_counter != self._resets:
            is_new = self._place_ned_m is None
            self._place_ned_m, self._resets = at.position_ned_m, at.reset_counter
            if is_new:
                self._velocity_ned_m_s, self._yaw_rad = at.velocity_ned_m_s, yaw_of(at.ned_from_frd)
        velocity, yaw_rate = self._demanded(now_s, inbox, None if limits is None else limits.payload)
        self._move(velocity, yaw_rate, at, min(now_s - self._seen_s, STEP_S))
        return [self._setpoint(yaw_rate, at), *self._report(velocity, yaw_rate, at, now_s)]

    def _setpoint(self, yaw_rate: float, at: Pose) -> Setpoint:
        """Moving target; for a driven vehicle in motion, its speed and heading."""
        speed_m_s = math.hypot(*self._velocity_ned_m_s)
        is_driving = self.settings.is_driven and (speed_m_s > 0.0 or yaw_rate != 0.0)
        if is_driving:
            self._place_ned_m = at.position_ned_m
        is_turning = is_driving and speed_m_s < STANDING_M_S
        return Setpoint(
            action_id=self.action_id,
            position_ned_m=None if is_driving else self._place_ned_m,
            velocity_ned_m_s=_STILL if is_turning else self._velocity_ned_m_s,
            yaw_rad=self._yaw_rad if is_turning or not self.settings.is_driven else None,
        )

    def _demanded(self, now_s: float, inbox: Inbox, limits: MotionLimits | None) -> tuple[Vector3, float]:
        """Surge, sway and heave in m/s and the rate of turning in rad/s, within the limits; all 0 where none is live."""
        latest = inbox.latest(self.motion_demand)
        is_live = latest is not None and latest.t_s >= self._began_s and now_s - latest.t_s <= EXPIRES_S
        if is_live != self._is_live:
            self._is_live, self._last_report_s = is_live, -math.inf
            self.expired += not is_live
        if latest is None or limits is None or not is_live:
            return _STILL, 0.0
        demand = latest.payload
        self.taken += demand is not self._last
        self._last = demand
        surge, sway, heave = (part / 100.0 for part in demand.velocity_cm_s)
        if self.settings.is_driven:
            surge, sway, heave = max(surge, 0.0), 0.0, 0.0
        most = self._order.speed_m_s or math.inf
        across = math.hypot(surge, sway)
        share = min(1.0, min(most, limits.speed_m_s) / across) if across > 0.0 else 1.0
        climb = min(most, limits.climb_m_s)
        turn = math.radians(self._order.yaw_rate_deg_s)
        yaw_rate = min(max(math.radians(demand.yaw_rate_cdeg_s / 100.0), -turn), turn)
        return (surge * share, sway * share, min(max(heave, -climb), climb)), yaw_rate

    def _move(self, level_m_s: Vector3, yaw_rate_rad_s: float, at: Pose, duration_s: float) -> None:
        """Moves target position and heading."""
        assert self._place_ned_m is not None
        settings, now_rad = self.settings, yaw_of(at.ned_from_frd)
        ahead = wrap_pi(self._yaw_rad + yaw_rate_rad_s * duration_s - now_rad)
        self._yaw_rad = wrap_pi(now_rad + min(max(ahead, -settings.turn_ahead_rad), settings.turn_ahead_rad))
        before, wanted = self._velocity_ned_m_s, turned(level_m_s, self._yaw_rad)
        most = settings.acceleration_m_s2 * duration_s
        if settings.is_driven:
            speed_m_s = _next(math.hypot(*before), level_m_s[0], most)
            after = turned((speed_m_s, 0.0, 0.0), self._yaw_rad)
        else:
            missing = math.dist(wanted[:2], before[:2])
            across = _towards(before, wanted, min(1.0, most / missing) if missing > 0.0 else 1.0)
            after = (across[0], across[1], _next(before[2], wanted[2], most))
        half_s = 0.5 * duration_s
        north, east, down = self._place_ned_m
        place = (
            north + (before[0] + after[0]) * half_s,
            east + (before[1] + after[1]) * half_s,
            down + (before[2] + after[2]) * half_s,
        )
        self._place_ned_m, self._velocity_ned_m_s = _limited(place, at.position_ned_m, settings.lead_m), after

    def _why(self, last: VelocityDemand | None) -> str:
        """Reason why the demand is not followed."""
        if last is None:
            return "no demand"
        if not self._is_live:
            return "the last demand has expired"
        surge, sway, heave = last.velocity_cm_s
        return ONLY_AHEAD if self.settings.is_driven and (surge < 0 or sway or heave) else ""

    def _report(self, velocity: Vector3, yaw_rate: float, at: Pose, now_s: float) -> list[Result]:
        """Reports to stations, five times a second and when demands start or end."""
        if now_s - self._last_report_s < REPORT_S - 1e-6:
            return []
        self._last_report_s = now_s
        last = self._last
        north, east, down = at.velocity_ned_m_s
        measured = turned((north, east, -down), -yaw_of(at.ned_from_frd))
        state = TeleoperationState(
            t_s=now_s,
            action_id=self.action_id,
            is_live=self._is_live,
            session=0 if last is None else last.session,
            sequence=-1 if last is None else last.sequence,
            velocity_cm_s=_in_cm(velocity) if self._is_live else AT_REST,
            measured_cm_s=_in_cm((measured[0], measured[1], -measured[2])),
            yaw_rate_cdeg_s=round(math.degrees(yaw_rate) * 100.0),
            measured_yaw_rate_cdeg_s=round(math.degrees(at.rate_frd_rad_s[2]) * 100.0),
            reason=self._why(last),
        )
        return [state]


def turned(level: Vector3, yaw_rad: float) -> Vector3:
    """Ahead, right and up, turned by a heading: north, east and down."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return (c * level[0] - s * level[1], s * level[0] + c * level[1], -level[2])


def _towards(here: Vector3, there: Vector3, share: float) -> Vector3:
    a, b, c = (x + (y - x) * share for x, y in zip(here, there, strict=True))
    return (a, b, c)


def _next(before: float, wanted: float, most: float) -> float:
    """A speed after a limited change."""
    return before + min(max(wanted - before, -most), most)


def _limited(place: Vector3, here: Vector3, lead_m: float) -> Vector3:
    """The target, limited in distance on the map and in height; a lagging vehicle keeps its height."""
    north, east, down = (there - at for there, at in zip(place, here, strict=True))
    across = math.hypot(north, east)
    share = lead_m / across if across > lead_m else 1.0
    return (here[0] + share * north, here[1] + share * east, here[2] + min(max(down, -lead_m), lead_m))


def _in_cm(velocity: Vector3) -> Velocity:
    surge, sway, heave = (round(part * 100.0) for part in velocity)
    return (surge, sway, heave)
