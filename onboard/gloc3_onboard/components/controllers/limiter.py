"""CC: the limiter between the controllers and the driver: one owner of motion, inside the limits and the fence."""

import math
from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.neighbours import Neighbours, SeparationState
from gloc3.messages.standard_topics import POSE_LATE_S, POSE_LOST_S
from gloc3.messages.vehicle import Manoeuvre, ManoeuvreKind, MotionGrant, MotionLimits, ObstacleScan, Pose, Setpoint
from gloc3_onboard.algorithms.mapping.movers import Movers
from gloc3_onboard.algorithms.mapping.obstacle_field import ObstacleField
from gloc3_onboard.algorithms.paths.motion_limits import SetpointLimiter, careful_speed_m_s
from gloc3_onboard.algorithms.paths.separation import Passage, SeparationRule
from gloc3_onboard.algorithms.paths.setpoint_gate import SETPOINT_AGE_S, SetpointGate

ANY_SPEED_M_S: Final = 100.0
"""A limit of this is none."""
_AT_REST: Final = (0.0, 0.0, 0.0)
CLEAR_S: Final = 3.0
"""So long nothing has slowed the vehicle down before another one is reported out of the way, s."""


class LimiterSettings(Settings, frozen=True):
    """Settings of the limiter."""

    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Without a pose younger than this no setpoint passes: the fence could not be kept. The vehicle brakes, and holds."""
    keep_m: Annotated[float, Bounds(0.3, 10.0)] = 1.1
    """Distance from the vehicle's middle to any obstacle that is wanted, in metres."""
    obstacles_limit_s: Annotated[float, Bounds(0.1, 10.0)] = 1.0
    """Obstacles that were seen longer ago do not count."""
    blind_m_s: Annotated[float, Bounds(0.0, ANY_SPEED_M_S)] = ANY_SPEED_M_S
    """Its speed, at most, while no obstacles are reported, in m/s; 0: without a sensor that sees them it stays where it is."""
    full_quality: Annotated[float, Bounds(0.0, 1.0)] = 0.7
    """With a pose of less quality the vehicle slows down."""
    hold_quality: Annotated[float, Bounds(0.0, 0.99)] = 0.3
    """With a pose of no more quality it stays where it is."""
    careful_m_s: Annotated[float, Bounds(0.05, 10.0)] = 0.6
    """Its speed just below `full_quality`, in m/s; from there it falls to none at `hold_quality`."""


class Limiter(Controller[LimiterSettings]):
    """Forwards the owner's setpoints and manoeuvres within the limits; drops all others.

    While the pose is late (up to `POSE_LOST_S`), a vehicle that followed setpoints is braked and held by velocity
    setpoints, which need only the autopilot's own estimate.
    """

    loggable = ("clamped", "foreign", "stale", "not_finite", "reason")

    setpoint_wanted = Input(Setpoint, Keep.ALL)
    manoeuvre_wanted = Input(Manoeuvre, Keep.ALL)
    grant = Input(MotionGrant)
    limits = Input(MotionLimits)
    pose = Input(Pose)
    obstacles = Input(ObstacleScan)
    neighbours = Input(Neighbours)
    setpoint = Output(Setpoint, frame="ned")
    manoeuvre = Output(Manoeuvre)
    separation = Output(SeparationState)

    def __init__(self) -> None:
        self.clamped = self.foreign = self.stale = self.not_finite = 0
        self.reason = ""
        """Why the last setpoint was changed or held back; empty if it was not."""
        self._gate = SetpointGate()
        self._limiter: SetpointLimiter | None = None
        self._movers = Movers()
        self._seen_s = -math.inf
        self._limited_s = -math.inf
        """When a setpoint of the owner last passed; never, once a manoeuvre has."""
        self._kept_away = SeparationState()
        """What was reported last about other vehicles."""
        self._kept_away_s = -math.inf
        """When another vehicle last slowed this one down."""
        self._has_braked = False
        """Since the last pose that was not late."""

    def initialize(self, settings: LimiterSettings) -> None:
        """Adopts the settings; refuses a quality for a hold that is not below the one for full speed."""
        if settings.hold_quality >= settings.full_quality:
            raise Refused("hold_quality must be less than full_quality")
        self.settings = settings

    def start(self) -> None:
        """Waits for the limits."""
        self._limiter = None
        self._movers, self._seen_s = Movers(), -math.inf
        self._limited_s, self._has_braked = -math.inf, False

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Limits the setpoints of the owner of motion."""
        for limits in inbox.new(self.limits):
            if self._limiter is None:
                self._limiter = SetpointLimiter(limits.payload)
            self._limiter.limits = limits.payload
        grant = inbox.latest(self.grant)
        owner = grant.payload.action_id if grant is not None else ""
        for scan in inbox.new(self.obstacles):
            self._check_obstacles(scan, inbox.latest(self.pose))
        results: list[Result] = []
        for manoeuvre in inbox.new(self.manoeuvre_wanted):
            if owner and manoeuvre.payload.action_id == owner:
                self._limited_s = -math.inf
                results.append(self._limit_manoeuvre(manoeuvre.payload, inbox.latest(self.pose)))
            else:
                self._gate.foreign += 1
        wanted = self._gate.newest(inbox.new(self.setpoint_wanted), owner, now_s)
        pose = inbox.latest(self.pose)
        braked = self._wait(owner, pose, now_s) if pose is not None and pose.payload.is_valid else []
        results += braked
        if wanted is not None and not braked:
            results += self._limit(wanted, pose, inbox.latest(self.neighbours), now_s)
        gate = self._gate
        self.foreign, self.stale, self.not_finite = gate.foreign, gate.stale, gate.not_finite
        return results

    def _check_obstacles(self, scan: Envelope[ObstacleScan], pose: Envelope[Pose] | None) -> None:
        if self._limiter is None or pose is None or not scan.payload.is_valid or scan.t_s <= self._seen_s:
            return
        self._seen_s = scan.t_s
        at, points = pose.payload.position_ned_m, scan.payload.points_ne_m
        soon = self._movers.add_scan(points, at, scan.t_s, pose.payload.reset_counter)
        self._limiter.obstacles = ObstacleField(points, at, self.settings.keep_m, soon)

    def _limit(
        self,
        wanted: Envelope[Setpoint],
        pose: Envelope[Pose] | None,
        neighbours: Envelope[Neighbours] | None,
        now_s: float,
    ) -> list[Result]:
        if self._limiter is None:
            self.reason = "the limits are not known yet"
            return []
        if pose is None or not pose.payload.is_valid or now_s - pose.t_s > self.settings.pose_limit_s:
            self.reason = "there is no valid pose to check the fence with"
            return []
        place = pose.payload
        self._limited_s = now_s
        self._limiter.set_vehicle(place.position_ned_m, place.velocity_ned_m_s, pose.t_s, place.reset_counter)
        settings = self.settings
        self._limiter.careful_m_s = careful_speed_m_s(
            place.quality, settings.full_quality, settings.hold_quality, settings.careful_m_s
        )
        why_slow = f"the pose quality is too low ({place.quality:.2f})"
        if now_s - self._seen_s > settings.obstacles_limit_s:
            self._limiter.obstacles = None
            if settings.blind_m_s < min(self._limiter.careful_m_s, ANY_SPEED_M_S):
                self._limiter.careful_m_s, why_slow = settings.blind_m_s, "no obstacles are reported"
        passage, apart = self._passage(wanted.payload, place, neighbours, now_s)
        self._limiter.careful_m_s = min(self._limiter.careful_m_s, apart)
        limited = self._limiter.limit(wanted.payload, wanted.t_s)
        self.clamped += limited.is_clamped
        self.reason = limited.reason
        if passage.name:
            self.reason = f"it keeps away from {passage.name}, {passage.distance_m:.1f} m away"
        elif limited.is_clamped and self._limiter.careful_m_s < math.inf:
            slow = f"no more than {self._limiter.careful_m_s:.2f} m/s" if self._limiter.careful_m_s else "it holds"
            self.reason = f"{why_slow}: {slow}"
        results: list[Result] = [self.setpoint.report(limited.setpoint, t_s=wanted.t_s)]
        results += self._separation_state(passage, now_s)
        return results

    def _separation_state(self, passage: Passage, now_s: float) -> list[SeparationState]:
        """Reports a change; an end only after a while, since a vehicle that waits is let go and stopped again."""
        last = self._kept_away
        if passage.name:
            self._kept_away_s = now_s
        elif not last.name or now_s - self._kept_away_s < CLEAR_S:
            return []
        if (passage.name, passage.has_priority) == (last.name, last.has_priority):
            return []
        distance_m = round(passage.distance_m, 1) if passage.name else 0.0
        self._kept_away = SeparationState(name=passage.name, distance_m=distance_m, has_priority=passage.has_priority)
        return [self._kept_away]

    def _passage(
        self, wanted: Setpoint, place: Pose, neighbours: Envelope[Neighbours] | None, now_s: float
    ) -> tuple[Passage, float]:
        """What the other vehicles leave of a setpoint, and the speed that follows."""
        assert self._limiter is not None
        limits, others = self._limiter.limits, neighbours.payload.vehicles if neighbours is not None else ()
        if not others or limits.separation_m <= 0.0:
            return Passage(), math.inf
        at, target = place.position_ned_m, wanted.position_ned_m
        wish = wanted.velocity_ned_m_s or _AT_REST
        if target is not None and (length_m := math.dist(target, at)) > 0.0:
            speed = max(math.hypot(*wish), min(limits.speed_m_s, length_m)) / length_m
            wish = (speed * (target[0] - at[0]), speed * (target[1] - at[1]), speed * (target[2] - at[2]))
        rule = SeparationRule(limits.separation_m, limits.separation_height_m, 0.7 * limits.acceleration_m_s2)
        passage = rule.passage(at, place.velocity_ned_m_s, wish, others, now_s)
        return passage, passage.share * math.hypot(*wish) if passage.name else math.inf

    def _wait(self, owner: str, pose: Envelope[Pose], now_s: float) -> list[Result]:
        """Brings a vehicle that followed setpoints to rest while its late pose is waited for."""
        late_s, limiter = now_s - pose.t_s, self._limiter
        if limiter is None:
            return []
        if late_s <= self.settings.pose_limit_s:
            if self._has_braked:
                limiter.restart(pose.payload.position_ned_m, pose.payload.velocity_ned_m_s, pose.t_s)
            self._has_braked = False
            return []
        if not owner or late_s > POSE_LOST_S or self._limited_s < pose.t_s - SETPOINT_AGE_S:
            return []
        self._has_braked = True
        self.reason = f"the pose is late by {late_s:.1f} s: it brakes and holds"
        standing = limiter.limit(Setpoint(action_id=owner, velocity_ned_m_s=_AT_REST), now_s).setpoint
        return [self.setpoint.report(standing, t_s=now_s)]

    def _limit_manoeuvre(self, manoeuvre: Manoeuvre, pose: Envelope[Pose] | None) -> Manoeuvre:
        """A take-off's height counts from the ground below, where home is."""
        if manoeuvre.kind is not ManoeuvreKind.TAKE_OFF or self._limiter is None:
            return manoeuvre
        limits = self._limiter.limits
        highest_m = limits.height_max_m
        ground_ned_m = limits.home_ned_m or (pose.payload.position_ned_m if pose is not None else None)
        if ground_ned_m is not None:
            highest_m = min(highest_m, self._limiter.highest_m + ground_ned_m[2])
        if manoeuvre.height_m <= highest_m:
            return manoeuvre
        self.clamped += 1
        return Manoeuvre(
            action_id=manoeuvre.action_id, kind=manoeuvre.kind, height_m=highest_m, may_arm=manoeuvre.may_arm
        )
