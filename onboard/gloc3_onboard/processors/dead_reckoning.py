"""DP: the platform's pose by dead reckoning: DVL, heading and depth, set right by satellites at the surface."""

from collections.abc import Sequence
from math import hypot, isfinite, radians
from typing import Annotated, Final

from gloc3.component import DataProcessor
from gloc3.frames import IDENTITY, GeoPoint, TangentPlane, Vector3, from_yaw, rotate, wrap_pi, yaw_of
from gloc3.perception import BottomVelocity, SatelliteFix
from gloc3.ports import Inbox, Input, Output, Result
from gloc3.settings import Bounds, Settings
from gloc3.vehicle import AutopilotPose, Pose, Setpoint
from gloc3_onboard.dead_reckoner import DeadReckoner, Errors

_FIRST_FIXES: Final = 5
"""Fixes that are averaged before it begins."""
_FIX_GAP_S: Final = 1.0
"""Errors of fixes are alike for long: no more than one in this time is taken in."""
_ASKED_S: Final = 1.0
"""A setpoint that is older asks for nothing."""
_TO_PLACE: Final = 0.4
"""Speed at which a vehicle goes to a place that it is asked to, per metre…"""
_TO_PLACE_MAX_M_S: Final = 0.3
"""…and at most."""
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
    lost_std_m: Annotated[float, Bounds(1.0, 10_000.0)] = 50.0
    """A pose that is worse than this along an axis is not valid."""
    jump_m: Annotated[float, Bounds(0.05, 100.0)] = 0.5
    """A step by a fix that is longer than this counts as a jump."""
    unlocked_s: Annotated[float, Bounds(0.2, 60.0)] = 1.5
    """Without bottom lock for so long it says that it is adrift."""
    heading_std_deg: Annotated[float, Bounds(0.01, 20.0)] = 1.0
    """Standard deviation of heading and mounting angle together, before satellites have told more."""
    scale_std: Annotated[float, Bounds(0.0001, 0.1)] = 0.003
    """Standard deviation of the DVL's scale."""
    adrift_std_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.3
    """Standard deviation of the velocity where nothing measures it."""


class DeadReckoningProcessor(DataProcessor[DeadReckoningSettings]):
    """One pose for each of the autopilot's estimates, of which attitude, heading and depth are taken.

    Its covariance grows with the way and with the time adrift; losing bottom lock is said, not hidden. A fix at the surface
    that moves the pose by more than `jump_m` raises the reset counter.
    """

    settings_type = DeadReckoningSettings
    loggable = ("travelled_m", "adrift_s", "heading_error_deg", "std_m", "reset_counter", "reason")

    autopilot_pose = Input(AutopilotPose)
    dvl = Input(BottomVelocity)
    satellites = Input(SatelliteFix)
    setpoint = Input(Setpoint)
    pose = Output(Pose, frame="ned")

    def __init__(self) -> None:
        self.travelled_m = 0.0
        """Way over ground since the last fix."""
        self.adrift_s = 0.0
        """How long there has been no bottom lock."""
        self.heading_error_deg = 0.0
        self.std_m = 0.0
        self.reset_counter = 0
        self.reason = ""
        self._settings = DeadReckoningSettings()
        self._forget()

    def _forget(self) -> None:
        settings = self._settings
        self._filter = DeadReckoner(
            Errors(
                heading_rad=radians(settings.heading_std_deg),
                scale=settings.scale_std,
                adrift_m_s=settings.adrift_std_m_s,
            )
        )
        self._plane: TangentPlane | None = None
        self._origin_geo: tuple[float, float, float] | None = None
        self._now_s: float | None = None
        self._first: list[tuple[float, float, float]] = []
        self._is_begun = False
        self._lock_s: float | None = None
        self._fix_s = float("-inf")
        self._misfits = 0
        self._dvl_reason = ""
        self._attitude = IDENTITY
        self._asked: Setpoint | None = None

    def initialize(self, settings: DeadReckoningSettings) -> None:
        """Adopts the settings."""
        self._settings = settings
        self._forget()

    def start(self) -> None:
        """Begins without a past: where it is must be told anew."""
        self._forget()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes in what is new in the order of time; one pose for each of the autopilot's."""
        results: list[Result] = []
        asked = inbox.latest(self.setpoint)
        self._asked = asked.payload if asked is not None and now_s - asked.t_s < _ASKED_S else None
        poses = [(envelope.t_s, 2, envelope.payload) for envelope in inbox.new(self.autopilot_pose)]
        bottoms = [(envelope.t_s, 0, envelope.payload) for envelope in inbox.new(self.dvl)]
        fixes = [(envelope.t_s, 1, envelope.payload) for envelope in inbox.new(self.satellites)]
        for t_s, _, news in sorted([*poses, *bottoms, *fixes], key=lambda item: (item[0], item[1])):
            if isinstance(news, AutopilotPose):
                results.append(self.pose.report(self._place(news, t_s), t_s=t_s))
            elif isinstance(news, BottomVelocity):
                self._measure(news, t_s)
            elif isinstance(news, SatelliteFix):
                self._fix(news, t_s)
        return results

    # --- what comes ---

    def _advance(self, t_s: float) -> None:
        """Brings the filter to a time; what is older than it is taken as being of its time."""
        if self._now_s is None:
            self._now_s = t_s
        dt_s = t_s - self._now_s
        if dt_s <= 0.0:
            return
        is_measured = self._lock_s is not None and t_s - self._lock_s < self._settings.unlocked_s
        self._filter.predict(min(dt_s, 5.0), is_measured=is_measured, asked_m_s=self._asked_m_s())
        self.travelled_m += hypot(*self._filter.velocity_m_s) * dt_s
        self._now_s = t_s

    def _asked_m_s(self) -> tuple[float, float]:
        """The velocity that the vehicle is asked for: what is fed forward, and what leads to the place asked for."""
        asked = self._asked
        if asked is None:
            return (0.0, 0.0)
        vn, ve, _ = asked.velocity_ned_m_s or (0.0, 0.0, 0.0)
        if asked.position_ned_m is None:
            return vn, ve
        north, east = self._filter.position_m
        off_n, off_e = _TO_PLACE * (asked.position_ned_m[0] - north), _TO_PLACE * (asked.position_ned_m[1] - east)
        size = hypot(off_n, off_e)
        share = _TO_PLACE_MAX_M_S / size if size > _TO_PLACE_MAX_M_S else 1.0
        return vn + share * off_n, ve + share * off_e

    def _measure(self, bottom: BottomVelocity, t_s: float) -> None:
        if not bottom.is_valid:
            self._dvl_reason = self._dvl_reason or bottom.reason
            return
        self._advance(t_s)
        yaw = yaw_of(self._attitude)
        ned = rotate(self._attitude, bottom.velocity_frd_m_s)
        level = rotate(from_yaw(-yaw), ned)
        if self._filter.take_velocity(level[0], level[1], yaw, max(bottom.std_m_s, 1e-3)) <= 1.0:
            self._lock_s, self._dvl_reason = t_s, ""
        else:
            self._dvl_reason = "its velocity does not fit"

    def _fix(self, fix: SatelliteFix, t_s: float) -> None:
        if not fix.is_valid or self._plane is None or t_s - self._fix_s < _FIX_GAP_S - 1e-6:
            return
        self._fix_s = t_s
        north, east, _ = self._plane.ned_from_geo(*fix.place_geo)
        std = max(fix.std_m, 0.05)
        if not self._is_begun:
            self._first.append((north, east, std))
            if len(self._first) >= _FIRST_FIXES:
                count = len(self._first)
                self._begin(sum(n for n, _, _ in self._first) / count, sum(e for _, e, _ in self._first) / count, std)
            return
        self._advance(t_s)
        before = self._filter.position_m
        if self._filter.take_fix(north, east, std) <= 1.0:
            self._misfits = 0
        else:
            self._misfits += 1
            if self._misfits < _STUCK:
                return
            self._misfits = 0
            self._filter.begin(north, east, std)
        self.travelled_m = 0.0
        after = self._filter.position_m
        if hypot(after[0] - before[0], after[1] - before[1]) > self._settings.jump_m:
            self.reset_counter += 1

    def _begin(self, north_m: float, east_m: float, std_m: float) -> None:
        self._is_begun = True
        self._filter.begin(north_m, east_m, std_m)

    # --- what is told ---

    def _place(self, given: AutopilotPose, t_s: float) -> Pose:
        numbers = (*given.position_ned_m, *given.velocity_ned_m_s, *given.ned_from_frd)
        is_finite = all(map(isfinite, numbers))
        if is_finite:
            self._filter.turned(wrap_pi(yaw_of(given.ned_from_frd) - yaw_of(self._attitude)))
            self._attitude = given.ned_from_frd
        self._adopt_origin(given)
        self._advance(t_s)
        settings, reckoner = self._settings, self._filter
        north, east = reckoner.position_m
        vn, ve = reckoner.velocity_m_s
        std_n, std_e = reckoner.std_m
        self.std_m = max(std_n, std_e)
        self.adrift_s = 0.0 if self._lock_s is None else max(0.0, t_s - self._lock_s)
        self.heading_error_deg = reckoner.heading_error_rad * 57.29578
        is_adrift = self._lock_s is None or self.adrift_s > settings.unlocked_s
        self.reason = self._why_not(is_finite)
        is_valid = not self.reason
        if is_valid and is_adrift:
            self.reason = f"adrift: {self._dvl_reason or 'no velocity over the floor'}"
        down, down_m_s = given.position_ned_m[2], given.velocity_ned_m_s[2]
        return Pose(
            position_ned_m=(north, east, down if is_finite else 0.0),
            velocity_ned_m_s=(vn, ve, down_m_s if is_finite else 0.0),
            ned_from_frd=self._attitude,
            rate_frd_rad_s=given.rate_frd_rad_s if is_finite else (0.0, 0.0, 0.0),
            position_std_m=(std_n, std_e, 0.1),
            is_valid=is_valid,
            reason=self.reason,
            quality=0.0 if not is_valid else max(0.05, 1.0 - self.std_m / settings.lost_std_m),
            reset_counter=self.reset_counter,
            sources=["heading", "depth"] if is_adrift else ["dvl", "heading", "depth"],
            origin_geo=self._origin_geo,
        )

    def _why_not(self, is_finite: bool) -> str:
        if not is_finite:
            return "the autopilot's estimate is not finite"
        if self._origin_geo is None:
            return "the autopilot has not told its origin"
        if not self._is_begun:
            return "where it begins is not known: no fixes yet"
        if self.std_m > self._settings.lost_std_m:
            return f"lost: it is known to {self.std_m:.0f} m only"
        return ""

    def _adopt_origin(self, given: AutopilotPose) -> None:
        """Once the autopilot has told its own: the local frame's, if that is near, else that one."""
        if self._plane is not None or given.origin_geo is None:
            return
        settings, origin = self._settings, given.origin_geo
        wanted = settings.origin_geo
        if wanted is not None:
            away: Vector3 = TangentPlane(GeoPoint(*wanted)).ned_from_geo(origin[0], origin[1], wanted[2])
            if hypot(away[0], away[1]) <= settings.reach_m:
                origin = wanted
        self._origin_geo, self._plane = origin, TangentPlane(GeoPoint(*origin))
        if settings.begins_at_origin:
            self._begin(0.0, 0.0, 0.1)
