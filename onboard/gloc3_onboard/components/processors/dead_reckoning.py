"""DP: the platform's pose by dead reckoning: heading, and a DVL or wheels, corrected by satellites when visible."""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from math import hypot, isfinite, radians, sqrt
from typing import Annotated, Final

import msgspec
import numpy as np

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import (
    IDENTITY,
    GeoPoint,
    Quaternion,
    TangentPlane,
    Vector3,
    from_yaw,
    rotate,
    rotate_back,
    wrap_pi,
    yaw_of,
)
from gloc3.messages.perception import BottomVelocity, Odometry, SatelliteFix
from gloc3.messages.vehicle import AutopilotPose, Pose, Setpoint
from gloc3_onboard.algorithms.odometry.dead_reckoner import DeadReckoner, Errors
from gloc3_onboard.algorithms.odometry.velocity_trust import VelocityTrust
from gloc3_onboard.sensors.devices import Memory

_FIX_GAP_S: Final = 1.0
"""Interval of used fixes, s: their errors are correlated for long."""
_DOUBT_GAP_S: Final = 0.5
"""The same while fixes contradict the velocity, so that what drives by wrong wheels is found out soon, s."""
_REQUESTED_S: Final = 1.0
"""Age above which a setpoint is ignored, s."""
_TO_PLACE: Final = 0.4
"""Speed towards a requested position per metre of distance, 1/s…"""
_TO_PLACE_MAX_M_S: Final = 0.3
"""…and at most."""
_AIDED_S: Final = 2.0
"""After the last fix satellites count as lost, and so does the autopilot's own velocity with them."""
_LATE_S: Final = 1.0
"""Largest lateness at which a fix is propagated to the present by the velocity, s."""
KEPT_S: Final = 120.0
"""What was reckoned is carried on after a crash or a restart that is no longer ago than this."""
_DEPTH_STD_M: Final = 0.1
"""Standard deviation of the autopilot's depth in calm water."""
DEPTH_LOST_S: Final = 10.0
"""So long the last depth is held while the autopilot has no position."""
_ATTITUDE: Final = 2
"""Rank of an attitude among what is valid at the same time."""
_FLOATING: Final = 1000
"""So many depths, half a minute and more, tell the waves."""
_KEEP_S: Final = 1.0
"""How often the memory gets the reckoning."""
_STEP_S: Final = 5.0
"""Longest step of a prediction."""
_REPEATED_M: Final = 0.1
"""A fix that repeats the last place to the last digit, while the vehicle has moved so far, is not a new one."""
_STUCK: Final = 10
"""So many fixes in a row that do not fit mean that the reckoning is wrong, not the satellites."""


class DeadReckoningSettings(Settings, frozen=True):
    """Settings of the processor."""

    origin_geo: tuple[float, float, float] | None = None
    """Origin of the local frame: latitude and longitude in degrees, altitude above mean sea level in metres. None, or
    a place farther than `reach_m` away, takes the origin of the autopilot's estimator."""
    reach_m: Annotated[float, Bounds(1.0, 100_000.0)] = 5_000.0
    """Farthest distance at which a local frame is used."""
    begins_at_origin: bool = False
    """Begins at the origin, for tanks and halls where satellites are never seen; else with the first fixes."""
    first_fixes: Annotated[int, Bounds(1, 60)] = 5
    """Number of fixes, a second apart, averaged at the start."""
    is_level: bool = False
    """Whether the height is always 0, as for vehicles on the ground; else depth is the autopilot's."""
    lost_std_m: Annotated[float, Bounds(1.0, 10_000.0)] = 50.0
    """A pose that is worse than this along an axis is not valid."""
    blind_s: Annotated[float, Bounds(1.0, 3600.0)] = 6.0
    """Time without any velocity over ground and without satellites after which the pose is not valid, in seconds: a vehicle
    that is steered by a velocity which nothing measures runs away."""
    jump_m: Annotated[float, Bounds(0.05, 100.0)] = 0.5
    """A step by a fix that is longer than this counts as a jump."""
    unlocked_s: Annotated[float, Bounds(0.2, 60.0)] = 1.5
    """Time without bottom lock or wheel grip after which it reports drifting, in seconds."""
    heading_std_deg: Annotated[float, Bounds(0.01, 20.0)] = 1.0
    """Initial standard deviation of heading and mounting angle together, in degrees; satellites refine it."""
    deviation_std_deg: Annotated[float, Bounds(0.0, 20.0)] = 0.22918311805232927
    """Standard deviation of the part of the heading's error that another heading changes, as a compass's deviation."""
    scale_std: Annotated[float, Bounds(0.0001, 0.1)] = 0.003
    """Standard deviation of the scale of the DVL or of the wheels."""
    scale_walk: Annotated[float, Bounds(0.0, 0.1)] = 0.0
    """Random walk of the scale, per root second, as for wheels with varying slip."""
    acceleration_m_s2: Annotated[float, Bounds(0.01, 20.0)] = 0.12
    """Random walk of the velocity over ground, in m/s per root second; agile vehicles need more."""
    adrift_std_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.3
    """Standard deviation of the velocity where nothing measures it."""
    climb_m_s: Annotated[float, Bounds(0.0, 10.0)] = 0.4
    """How fast the depth may change while the autopilot does not tell it."""
    autopilot_std_m_s: Annotated[float, Bounds(0.0, 5.0)] = 0.0
    """Standard deviation of the autopilot's velocity, in m/s, used while satellites are visible and nothing else
    measures velocity; 0 disables it."""


class KeptReckoning(msgspec.Struct, frozen=True, array_like=True):
    """What is carried on after a crash or a restart."""

    t_s: float
    state: list[float]
    covariance: list[list[float]]
    origin_geo: tuple[float, float, float]
    down_m: float
    common_m: float
    reset_counter: int
    waves_m2: float = 0.0


class DeadReckoningProcessor(DataProcessor[DeadReckoningSettings]):
    """One pose for each of the autopilot's estimates, of which attitude, heading and depth are taken.

    Its covariance grows with the way and with the time adrift; losing bottom lock is said, not hidden. A fix that moves the
    pose by more than `jump_m` raises the reset counter. While the autopilot has no position, its attitude is enough: the
    position that it lacks may be the one reckoned here. After a crash, or with a memory after a restart of the process, the
    reckoning goes on from where it was, adrift for as long as nobody reckoned.

    Args:
        memory: keeps the reckoning, once a second.
    """

    needs_one_of = ("dvl", "odometry", "satellites")
    loggable = ("travelled_m", "adrift_s", "heading_error_deg", "std_m", "reset_counter", "reason")

    autopilot_pose = Input(AutopilotPose)
    autopilot_attitude = Input(AutopilotPose)
    dvl = Input(BottomVelocity)
    odometry = Input(Odometry)
    satellites = Input(SatelliteFix)
    setpoint = Input(Setpoint)
    pose = Output(Pose, frame="ned")

    def __init__(self, memory: Memory | None = None) -> None:
        self._memory = memory
        self.travelled_m = 0.0
        """Way over ground since the last fix."""
        self.adrift_s = 0.0
        """How long there has been no bottom lock."""
        self.heading_error_deg = 0.0
        self.std_m = 0.0
        self.reset_counter = 0
        self.reason = ""
        self._reset()

    def _reset(self) -> None:
        settings = self.settings
        self._filter = DeadReckoner(
            Errors(
                heading_rad=radians(settings.heading_std_deg),
                deviation_rad=radians(settings.deviation_std_deg),
                scale=settings.scale_std,
                scale_walk=settings.scale_walk,
                acceleration_m_s2=settings.acceleration_m_s2,
                adrift_m_s=settings.adrift_std_m_s,
            )
        )
        self._plane: TangentPlane | None = None
        self._origin_geo: tuple[float, float, float] | None = None
        self._now_s: float | None = None
        self._first: list[tuple[float, float, float]] = []
        self._is_begun = False
        self._lock_s: float | None = None
        self._fix_s = self._seen_s = float("-inf")
        self._aided_s = float("inf")
        """When there was a velocity over ground, or satellites; infinite before the first pose."""
        self._common_m = 0.0
        """What errors of fixes have in common for long: many of them are no better than one."""
        self._source = "dvl"
        self._trust = VelocityTrust()
        self._misfits = 0
        self._place_geo: Vector3 | None = None
        """The place of the last fix."""
        self._moved_m = (0.0, 0.0)
        """Way by measured velocity since the fixes have told that place, north and east."""
        self._unlocked = ""
        self._attitude: Quaternion | None = None
        """The autopilot's last; before it, a velocity in the body's axes says nothing."""
        self._requested: Setpoint | None = None
        self._down_m, self._depth_s = 0.0, float("-inf")
        """The autopilot's last depth, and when it told it."""
        self._waves_m2 = 0.0
        """Variance of the depth while it floats, before anything is asked of it. The autopilot's zero is the depth of one
        such moment."""
        self._floating: deque[float] | None = deque(maxlen=_FLOATING)
        """The last depths of that time; None once it is over."""
        self._kept: KeptReckoning | None = None
        """What is to be carried on."""
        self._kept_s = float("-inf")

    def initialize(self, settings: DeadReckoningSettings) -> None:
        """Adopts the settings."""
        kept = self._to_keep() or self._kept
        self.settings = settings
        self._reset()
        self._kept = kept

    def start(self) -> None:
        """Carries on what was reckoned a moment ago; else where it is must be told anew."""
        kept = self._to_keep() or self._kept or self._remembered()
        self._reset()
        self._kept = kept

    def _to_keep(self) -> KeptReckoning | None:
        if not self._is_begun or self._now_s is None or self._origin_geo is None:
            return None
        return KeptReckoning(
            self._now_s,
            self._filter.x.tolist(),
            self._filter.covariance.tolist(),
            self._origin_geo,
            self._down_m,
            self._common_m,
            self.reset_counter,
            self._waves_m2,
        )

    def _remembered(self) -> KeptReckoning | None:
        data = None if self._memory is None else self._memory.load()
        with suppress(msgspec.DecodeError):  # of another version: nothing is known
            return None if data is None else msgspec.msgpack.decode(data, type=KeptReckoning)
        return None

    def _carry_on(self, now_s: float) -> None:
        """Adopts what was kept, unless it is too old."""
        kept, self._kept = self._kept, None
        if kept is None or not 0.0 <= now_s - kept.t_s <= KEPT_S:
            return
        self._filter.x = np.array(kept.state)
        self._filter.covariance = np.array(kept.covariance)
        self._origin_geo, self._plane = kept.origin_geo, TangentPlane(GeoPoint(*kept.origin_geo))
        self._now_s, self._is_begun = kept.t_s, True
        self._down_m, self._depth_s, self._common_m = kept.down_m, kept.t_s, kept.common_m
        self.reset_counter, self._waves_m2, self._floating = kept.reset_counter, kept.waves_m2, None

    def _keep(self, now_s: float) -> None:
        if self._memory is None or now_s - self._kept_s < _KEEP_S - 1e-6:
            return
        kept = self._to_keep()
        if kept is not None:
            self._kept_s = now_s
            self._memory.keep(msgspec.msgpack.encode(kept))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Handles new data in order of time; one pose for each of the autopilot's."""
        results: list[Result] = []
        if self._kept is not None:
            self._carry_on(now_s)
        requested = inbox.latest(self.setpoint)
        if requested is not None:
            self._floating = None
        self._requested = requested.payload if requested is not None and now_s - requested.t_s < _REQUESTED_S else None
        poses = [(envelope.t_s, 3, envelope.payload) for envelope in inbox.new(self.autopilot_pose)]
        attitudes = [(envelope.t_s, _ATTITUDE, envelope.payload) for envelope in inbox.new(self.autopilot_attitude)]
        bottoms = [(envelope.t_s, 0, envelope.payload) for envelope in inbox.new(self.dvl)]
        steps = [(envelope.t_s, 0, envelope.payload) for envelope in inbox.new(self.odometry)]
        fixes = [(envelope.t_s, 1, envelope.payload) for envelope in inbox.new(self.satellites)]
        for t_s, rank, reports in sorted(
            [*poses, *attitudes, *bottoms, *steps, *fixes], key=lambda item: (item[0], item[1])
        ):
            if rank == _ATTITUDE and isinstance(reports, AutopilotPose):
                results += self._place_by_attitude(reports, t_s)
            elif isinstance(reports, AutopilotPose):
                results.append(self.pose.report(self._place(reports, t_s), t_s=t_s))
            elif isinstance(reports, BottomVelocity):
                self._measure(reports, t_s)
            elif isinstance(reports, Odometry):
                self._follow(reports, t_s)
            elif isinstance(reports, SatelliteFix):
                self._fix(reports, t_s)
        self._keep(now_s)
        return results

    # --- what comes ---

    def _advance(self, t_s: float) -> None:
        """Advances the filter to a time; older data are treated as of the filter's time."""
        if self._now_s is None:
            self._now_s = t_s
        dt_s = t_s - self._now_s
        if dt_s <= 0.0:
            return
        is_measured = self._lock_s is not None and t_s - self._lock_s < self.settings.unlocked_s
        requested_m_s, left_s = self._requested_m_s(), dt_s
        while left_s > 0.0:
            step_s = min(left_s, _STEP_S)
            self._filter.predict(step_s, is_measured=is_measured, commanded_m_s=requested_m_s)
            left_s -= step_s
        vn, ve = self._filter.velocity_m_s
        self.travelled_m += hypot(vn, ve) * dt_s
        if is_measured:
            self._moved_m = (self._moved_m[0] + vn * dt_s, self._moved_m[1] + ve * dt_s)
        self._now_s = t_s

    def _requested_m_s(self) -> tuple[float, float]:
        """The requested velocity: feed-forward, plus the correction towards the requested position."""
        requested = self._requested
        if requested is None:
            return (0.0, 0.0)
        vn, ve, _ = requested.velocity_ned_m_s or (0.0, 0.0, 0.0)
        if requested.position_ned_m is None:
            return vn, ve
        north, east = self._filter.position_m
        off_n, off_e = (
            _TO_PLACE * (requested.position_ned_m[0] - north),
            _TO_PLACE * (requested.position_ned_m[1] - east),
        )
        size = hypot(off_n, off_e)
        share = _TO_PLACE_MAX_M_S / size if size > _TO_PLACE_MAX_M_S else 1.0
        return vn + share * off_n, ve + share * off_e

    def _measure(self, bottom: BottomVelocity, t_s: float) -> None:
        if not bottom.is_valid:
            self._unlocked = self._unlocked or bottom.reason
            return
        std_m_s = max(bottom.std_m_s, 1e-3)
        self._add_velocity("dvl", bottom.velocity_frd_m_s, (std_m_s, std_m_s), t_s)

    def _follow(self, step: Odometry, t_s: float) -> None:
        """A step of an odometer is a velocity: that of its chord, in the axes that the body has at its end."""
        seconds = t_s - step.reference_t_s
        if not step.is_valid or seconds <= 0.0:
            self._unlocked = self._unlocked or step.reason
            return
        # Chord in the body's axes at its end, R^T p, over its time; deviations from the covariance over that time.
        ahead, right, down = rotate_back(step.reference_from_frd, step.position_m)
        vn, ve = self._filter.velocity_m_s
        speed_m_s, believed_m_s = hypot(ahead, right) / seconds, hypot(vn, ve)
        reason = self._trust.why_not(
            speed_m_s,
            hypot(*self._requested_m_s()),
            abs(speed_m_s - believed_m_s),
            t_s,
            has_satellites=t_s - self._seen_s < _AIDED_S,
        )
        if reason:
            self._unlocked, self._lock_s = reason, None
            return
        stds = (max(sqrt(step.covariance[0]) / seconds, 1e-3), max(sqrt(step.covariance[7]) / seconds, 1e-3))
        self._add_velocity(step.source, (ahead / seconds, right / seconds, down / seconds), stds, t_s)

    def _add_velocity(self, source: str, velocity_frd_m_s: Vector3, stds_m_s: tuple[float, float], t_s: float) -> None:
        if self._attitude is None:
            return
        self._advance(t_s)
        yaw = yaw_of(self._attitude)
        # Level axes, ahead and to the right: R_yaw^T R v; what points down is left out.
        level = rotate(from_yaw(-yaw), rotate(self._attitude, velocity_frd_m_s))
        if self._filter.use_velocity(level[0], level[1], yaw, *stds_m_s) <= 1.0:
            self._source, self._lock_s, self._unlocked = source, t_s, ""
        else:
            self._unlocked = "its velocity does not fit"

    def _fix(self, fix: SatelliteFix, t_s: float) -> None:
        if not fix.is_valid:
            self._seen_s = float("-inf")
            return
        if fix.place_geo != self._place_geo:
            self._place_geo, self._moved_m = fix.place_geo, (0.0, 0.0)
        elif hypot(*self._moved_m) > _REPEATED_M:
            return
        self._seen_s = t_s
        gap_s = _DOUBT_GAP_S if self._trust.is_doubted else _FIX_GAP_S
        if self._plane is None or t_s - self._fix_s < gap_s - 1e-6:
            return
        self._fix_s = t_s
        north, east, _ = self._plane.ned_from_geo(*fix.place_geo)
        std, self._common_m = max(fix.std_m, 0.05), fix.std_m
        # Start: the mean of the first fixes. Their errors last longer than that: the deviation is that of one.
        if not self._is_begun:
            self._first.append((north, east, std))
            if len(self._first) >= self.settings.first_fixes:
                count = len(self._first)
                self._begin(sum(n for n, _, _ in self._first) / count, sum(e for _, e, _ in self._first) / count, std)
            return
        self._advance(t_s)
        # Late fix: moved on by the velocity, z + v dt, as older states are not kept.
        late_s = 0.0 if self._now_s is None else min(max(0.0, self._now_s - t_s), _LATE_S)
        vn, ve = self._filter.velocity_m_s
        before = self._filter.position_m
        # Gate and update; fixes that never fit are right in the end, and begin the reckoning again.
        fits = self._filter.use_fix(north + vn * late_s, east + ve * late_s, std) <= 1.0
        is_distrusted = self.settings.autopilot_std_m_s > 0.0 and self._trust.fix(fits=fits)
        if is_distrusted:
            self._filter.inflate_velocity()
            self._lock_s = None
        if fits:
            self._misfits = 0
        else:
            self._misfits += 1
            if self._misfits < _STUCK and not is_distrusted:
                return
            self._misfits = 0
            self._filter.begin(north, east, std)
        self.travelled_m = 0.0
        after = self._filter.position_m
        if hypot(after[0] - before[0], after[1] - before[1]) > self.settings.jump_m:
            self.reset_counter += 1

    def _begin(self, north_m: float, east_m: float, std_m: float) -> None:
        self._is_begun = True
        self._filter.begin(north_m, east_m, std_m)

    # --- what is told ---

    def _place_by_attitude(self, given: AutopilotPose, t_s: float) -> list[Result]:
        """A pose at the last depth, while the autopilot has no position; none before the reckoning has begun."""
        if not self._is_begun:
            return []
        held = msgspec.structs.replace(given, position_ned_m=(0.0, 0.0, self._down_m))
        return [self.pose.report(self._place(held, t_s, has_position=False), t_s=t_s)]

    def _place(self, given: AutopilotPose, t_s: float, *, has_position: bool = True) -> Pose:
        numbers = (*given.position_ned_m, *given.velocity_ned_m_s, *given.ned_from_frd, *given.rate_frd_rad_s)
        is_finite = all(map(isfinite, numbers))
        if is_finite:
            if self._attitude is not None:
                self._filter.turned(wrap_pi(yaw_of(given.ned_from_frd) - yaw_of(self._attitude)))
            self._attitude = given.ned_from_frd
        self._adopt_origin(given)
        self._advance(t_s)
        is_unlocked = self._lock_s is None or t_s - self._lock_s > self.settings.unlocked_s
        has_satellites = t_s - self._seen_s < _AIDED_S
        is_guided = is_unlocked and has_satellites and self.settings.autopilot_std_m_s > 0.0 and is_finite
        is_guided &= has_position
        if is_finite and has_position and given.has_height:
            self._down_m, self._depth_s = given.position_ned_m[2], t_s
            if self._floating is not None and not self.settings.is_level:
                self._floating.append(self._down_m)
                self._waves_m2 = float(np.var(self._floating))
        if is_guided:
            self._lean_on(given)
        settings, reckoner = self.settings, self._filter
        north, east = reckoner.position_m
        vn, ve = reckoner.velocity_m_s
        std_n, std_e = (hypot(std, self._common_m) for std in reckoner.std_m)
        self.std_m = max(std_n, std_e)
        self.adrift_s = 0.0 if self._lock_s is None else max(0.0, t_s - self._lock_s)
        self.heading_error_deg = reckoner.heading_error_rad * 57.29578
        is_adrift = is_unlocked and not is_guided
        unknown_s = 0.0 if settings.is_level else max(0.0, t_s - self._depth_s)
        self._aided_s = t_s if has_satellites or not is_unlocked else min(self._aided_s, t_s)
        self.reason = self._why_not(is_finite, unknown_s, t_s - self._aided_s)
        is_valid = not self.reason
        if is_valid and is_adrift:
            self.reason = f"adrift: {self._unlocked or 'no velocity over ground'}"
        has_depth = is_finite and not settings.is_level
        sources = [] if is_adrift else ["autopilot"] if is_guided else [self._source]
        sources += ["heading"] if settings.is_level else ["heading", "depth"]
        sources += ["satellites"] if has_satellites else []
        return Pose(
            position_ned_m=(north, east, given.position_ned_m[2] if has_depth else 0.0),
            velocity_ned_m_s=(vn, ve, given.velocity_ned_m_s[2] if has_depth else 0.0),
            ned_from_frd=self._attitude or IDENTITY,
            rate_frd_rad_s=given.rate_frd_rad_s if is_finite else (0.0, 0.0, 0.0),
            position_std_m=(std_n, std_e, hypot(_DEPTH_STD_M, sqrt(self._waves_m2)) + settings.climb_m_s * unknown_s),
            is_valid=is_valid,
            reason=self.reason,
            quality=0.0 if not is_valid else max(0.05, 1.0 - self.std_m / settings.lost_std_m),
            reset_counter=self.reset_counter,
            sources=sources,
            origin_geo=self._origin_geo,
        )

    def _lean_on(self, given: AutopilotPose) -> None:
        """Takes the autopilot's own velocity, where nothing better is there: it has it from the satellites."""
        yaw, std_m_s = yaw_of(given.ned_from_frd), self.settings.autopilot_std_m_s
        ahead, right, _ = rotate(from_yaw(-yaw), given.velocity_ned_m_s)
        self._filter.use_velocity(ahead, right, yaw, std_m_s)

    def _why_not(self, is_finite: bool, unknown_s: float, blind_s: float) -> str:
        if not is_finite:
            return "the autopilot's estimate is not finite"
        if self._origin_geo is None:
            return "the autopilot has not sent its origin"
        if not self._is_begun:
            return "the start position is not known: no fixes yet"
        if unknown_s > DEPTH_LOST_S:
            return "the autopilot has no position, and reports no depth"
        if blind_s > self.settings.blind_s:
            return f"adrift: {self._unlocked or 'no velocity over ground'} for {blind_s:.0f} s"
        if self.std_m > self.settings.lost_std_m:
            return f"lost: its standard deviation is {self.std_m:.0f} m"
        return ""

    def _adopt_origin(self, given: AutopilotPose) -> None:
        """Sets the origin once the autopilot has reported its own: the local frame's if near, else the autopilot's."""
        if self._plane is not None or given.origin_geo is None:
            return
        settings, origin = self.settings, given.origin_geo
        wanted = settings.origin_geo
        if wanted is not None:
            away: Vector3 = TangentPlane(GeoPoint(*wanted)).ned_from_geo(origin[0], origin[1], wanted[2])
            if hypot(away[0], away[1]) <= settings.reach_m:
                origin = wanted
        self._origin_geo, self._plane = origin, TangentPlane(GeoPoint(*origin))
        if settings.begins_at_origin:
            self._begin(0.0, 0.0, 0.1)
