"""Laser odometry: aligns each scan to a local map of the walls seen lately."""

from typing import Annotated, Final, NamedTuple

import msgspec
import numpy as np

from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import wrap_pi
from gloc3.messages.perception import UNKNOWN_VARIANCE, LaserScan
from gloc3_onboard.algorithms.scan_matching.correlative import SearchWindow
from gloc3_onboard.algorithms.scan_matching.lines import lines_of
from gloc3_onboard.algorithms.scan_matching.local_map import LocalMap
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.point_to_line import NEAR_M, ScanAlignment, align, search
from gloc3_onboard.algorithms.scan_matching.scan_points import (
    FEWEST_BEAMS,
    Mount,
    ScanPoints,
    Tilt,
    fault_of,
    points_of,
)

LEVEL: Final = Tilt()
AT_BODY: Final = Mount()
MOST_FAILURES: Final = 5
"""Consecutive bad scans after which earlier data are dropped."""
LONGEST_S: Final = 2.0
"""A velocity is not believed for longer."""
REPORTED_M: Final = 0.1
REPORTED_SHARE: Final = 0.15
REPORTED_RAD: Final = 0.1
REPORTED_TURN_SHARE: Final = 0.5
"""Largest error of a motion reported by others: absolute, and as a share of distance and turn."""
FIRST_M_S: Final = 1.0
FIRST_RAD_S: Final = 0.5
"""The first motion of all is about so fast at most."""
SURE_M: Final = 0.25
SURE_RAD: Final = 0.15
"""A scan that lies no farther from where it is expected is fitted at once, without a search."""
CAUTION: Final = 1.8
"""Residuals of things that are no walls, such as tops of boxes, are alike: errors are larger than they suggest."""
DARK_S: Final = 2.0
BETTER: Final = 0.1
"""Margin by which an unexpected position must fit better."""
LEAN: Final = 0.75
"""Tilt allowance of walls: uncertainty of their position at another height, as a share of the climb."""
LEVEL_M: Final = 0.03
"""Climb below which the height counts as constant, m; longer climbs count from their start."""
NEW_LEVEL_M: Final = 0.2
"""Climb after which the map restarts, m."""
_FULL_TRUST: Final = np.zeros((3, 3))
_FLOOR: Final = np.diag((0.001**2, 0.001**2, 0.0002**2))
"""No fit is better than this: walls are not quite straight, nor is the clock of the scanner."""


class LaserOdometerSettings(Settings, frozen=True):
    """Settings of the laser odometer."""

    reach_m: Annotated[float, Bounds(1.0, 1000.0)] = 30.0
    """Length of path whose walls the map holds, m."""
    key_distance_m: Annotated[float, Bounds(0.05, 10.0)] = 0.5
    """Distance after which the map adds a scan, m…"""
    key_turn_rad: Annotated[float, Bounds(0.02, 3.0)] = 0.35
    """…or turn, rad…"""
    key_share: Annotated[float, Bounds(0.1, 1.0)] = 0.7
    """…or the share of a scan on the map falls below this."""
    good_share: Annotated[float, Bounds(0.1, 1.0)] = 0.6
    """Share of fitting points below which a scan is searched for all around."""
    lowest_share: Annotated[float, Bounds(0.05, 1.0)] = 0.25
    """A scan of which less fits into the map is lost."""
    acceleration_m_s2: Annotated[float, Bounds(0.1, 50.0)] = 3.0
    """How much the motion may change between two scans:"""
    turn_acceleration_rad_s2: Annotated[float, Bounds(0.1, 100.0)] = 6.0
    """Turn acceleration for the search range around the expected pose, rad/s²."""
    search_m: Annotated[float, Bounds(0.1, 5.0)] = 1.5
    """but no farther than this,"""
    search_rad: Annotated[float, Bounds(0.1, 3.2)] = 1.2
    """and this."""


class LaserMotion(msgspec.Struct, frozen=True, kw_only=True):
    """Planar motion of the body since a reference, on the reference's level axes (x forward, y right)."""

    t_s: float
    reference_t_s: float
    """Time of the reference pose."""
    motion: Planar
    covariance: Array
    """3 by 3: x, y, heading; `UNKNOWN_VARIANCE` along directions that the walls do not constrain."""
    pose: Planar
    """The body's pose since the start, on the axes of the first scan."""
    is_valid: bool = True
    reason: str = ""
    quality: float = 1.0
    """Share of the scan on walls of the map."""
    is_degenerate: bool = False
    """Whether the walls leave a direction unconstrained."""


class LaserOdometer:
    """Estimates motion from scans. A bad scan yields an invalid motion with a reason, and changes nothing."""

    def __init__(self, settings: LaserOdometerSettings | None = None, mount: Mount = AT_BODY) -> None:
        self._settings = settings or LaserOdometerSettings()
        self._mount = mount
        self._has_begun = False
        self._pose, self._t_s = Planar(), 0.0
        self._ranges = b""
        self._map = LocalMap(self._settings.reach_m)
        self._key_pose, self._key_t_s, self._key_covariance = Planar(), 0.0, _FULL_TRUST
        self._velocity: Planar | None = None
        self._reported: Planar | None = Planar()
        self._heading_rad: float | None = None
        self._travelled_m = 0.0
        self._height_m: float | None = None
        """Reference height of climbs: follows the height of the motion's reference, `LEVEL_M` behind."""
        self._map_height_m: float | None = None
        """Of the scan that the map began with."""
        self._bad = 0

    def update(
        self,
        scan: LaserScan,
        t_s: float,
        tilt: Tilt = LEVEL,
        heading_rad: float | None = None,
        guess: Planar | None = None,
    ) -> LaserMotion:
        """Processes a scan.

        Args:
            scan: the scan.
            t_s: its end time.
            tilt: tilt of the body.
            heading_rad: heading of the body, from any source with slow drift; only its change is used, to predict the
                pose.
            guess: motion of the body since the previous call, on the axes of that time, if known; used the same way.

        Returns:
            The motion since the reference.
        """
        self._reported = self._reported @ guess if self._reported is not None and guess is not None else None
        fault = fault_of(scan) or self._fault_in_time(scan, t_s)
        if fault:
            return self._nothing(t_s, fault)
        expected = self._expected(t_s - self._t_s, heading_rad) if self._has_begun else Expected(Planar(), None)
        points = points_of(scan, tilt, self._mount, self._skew(scan.duration_s, t_s, expected.motion, heading_rad))
        if len(points.points_m) < FEWEST_BEAMS:
            return self._nothing(t_s, "hardly anything of the scan is above the floor")
        self._ranges = scan.ranges_m
        if not self._has_begun:
            self._height_m = self._map_height_m = tilt.height_m
            return self._begin(points, Planar(), t_s, heading_rad, "the map starts with this scan")
        found = self._fit(points.points_m, expected)
        if found.share < self._settings.lowest_share:
            return self._lose(points, expected, found.share, t_s, heading_rad)
        return self._adopt(points, found, t_s, heading_rad, tilt.height_m)

    # --- what is expected ---

    def _fault_in_time(self, scan: LaserScan, t_s: float) -> str:
        if not self._has_begun:
            return ""
        if t_s <= self._t_s:
            if self._bad >= MOST_FAILURES:
                self._has_begun = False
                return ""
            return "the scan is not newer than the one before"
        return "the scan is, beam for beam, the one before" if scan.ranges_m == self._ranges else ""

    def _expected(self, duration_s: float, heading_rad: float | None) -> "Expected":
        """The motion since the last good scan, and how wrong that may be."""
        settings, reported, velocity = self._settings, self._reported, self._velocity
        # Constant velocity, within a window of a dt^2 / 2; a reported motion or heading may replace it.
        half_square = 0.5 * duration_s * duration_s
        distance_m = settings.acceleration_m_s2 * half_square
        turn_rad = settings.turn_acceleration_rad_s2 * half_square
        motion = Planar()
        if velocity is not None:
            motion = velocity.part(min(duration_s, LONGEST_S))
        else:
            distance_m += FIRST_M_S * duration_s
            turn_rad += FIRST_RAD_S * duration_s
        if (
            reported is not None and distance_m > REPORTED_M
        ):  # over a short time nobody knows better than the last motion
            motion = reported
            distance_m = REPORTED_M + REPORTED_SHARE * motion.distance_m
            turn_rad = REPORTED_RAD + REPORTED_TURN_SHARE * abs(motion.yaw_rad)
        # After a scan that did not fit, a heading that has leapt is not believed any longer.
        if heading_rad is not None and self._heading_rad is not None and self._bad < 1:
            motion = Planar(motion.x_m, motion.y_m, wrap_pi(heading_rad - self._heading_rad))
            turn_rad = REPORTED_RAD
        return Expected(motion, SearchWindow(min(distance_m, settings.search_m), min(turn_rad, settings.search_rad)))

    def _skew(self, scan_s: float, t_s: float, expected: Planar, heading_rad: float | None) -> Planar:
        """Motion during a scan: that of the last one, which is smoother than the wheels'."""
        if not self._has_begun or scan_s <= 0.0:
            return Planar()
        share = min(1.0, scan_s / (t_s - self._t_s))
        if self._velocity is None:
            return expected.part(share)
        before = self._velocity.part(min(scan_s, LONGEST_S))
        return before if heading_rad is None else Planar(before.x_m, before.y_m, share * expected.yaw_rad)

    # --- what is found ---

    def _fit(self, points: Array, expected: "Expected") -> ScanAlignment:
        """Near the expected place if that is well known, else, or if it does not fit there, all around it."""
        guess, window = self._pose @ expected.motion, expected.window
        assert window is not None
        # Local alignment where the window is small; else, or where it fits badly, correlative search.
        is_sure = window.distance_m <= SURE_M and window.heading_rad <= SURE_RAD
        near = align(points, self._map, guess, window.distance_m + NEAR_M) if is_sure else None
        if near is not None and near.share >= self._settings.good_share:
            return near
        wide = SearchWindow(max(window.distance_m, SURE_M), max(window.heading_rad, SURE_RAD))
        found = search(points, self._map, guess, wide)
        return near if near is not None and near.share >= found.share - BETTER else found

    def _adopt(
        self, points: ScanPoints, found: ScanAlignment, t_s: float, heading_rad: float | None, height_m: float | None
    ) -> LaserMotion:
        information = found.information._replace(sigma_m=CAUTION * found.information.sigma_m)
        # Covariance of the fit, plus a floor, plus walls that lean where the height has changed.
        covariance = information.covariance(UNKNOWN_VARIANCE) + _FLOOR
        climb_m = _between(height_m, self._height_m)
        covariance[:2, :2] += max(0.0, LEAN * (abs(climb_m) - LEVEL_M)) ** 2 * np.eye(2)
        step = self._pose.inverse() @ found.pose
        self._velocity = step.part(1.0 / (t_s - self._t_s))
        self._travelled_m += step.distance_m
        self._settle(found.pose, t_s, heading_rad)
        motion = self._key_pose.inverse() @ found.pose
        # Report relative to the key pose; a new key where it is far, poorly observed or badly covered.
        report = LaserMotion(
            t_s=t_s,
            reference_t_s=self._key_t_s,
            motion=motion,
            covariance=_since(self._key_pose, self._key_covariance, found.pose, covariance),
            pose=found.pose,
            quality=found.share,
            is_degenerate=found.information.is_degenerate,
        )
        settings = self._settings
        is_far = motion.distance_m > settings.key_distance_m or abs(motion.yaw_rad) > settings.key_turn_rad
        is_degenerate = found.information.is_degenerate
        has_climbed = abs(_between(height_m, self._map_height_m)) > NEW_LEVEL_M
        # Who does not know how far it has come may be far: the direction that is not known is only known so well.
        is_far |= is_degenerate and t_s - self._key_t_s > DARK_S
        if is_far or has_climbed or found.share < settings.key_share:
            is_new = is_degenerate or has_climbed
            self._add_scan(points, t_s, covariance, is_new=is_new)
            if height_m is not None:
                self._height_m = height_m - max(-LEVEL_M, min(climb_m, LEVEL_M))
                self._map_height_m = height_m if is_new or self._map_height_m is None else self._map_height_m
        return report

    def _add_scan(self, points: ScanPoints, t_s: float, covariance: Array, *, is_new: bool) -> None:
        """Makes the present place the reference, and its scan part of the map; or the begin of a new one.

        Along a direction that is not known, a scan cannot be put where it belongs in the map.
        """
        if is_new:
            self._map = LocalMap(self._settings.reach_m)
        self._map.add(lines_of(points), self._pose, self._travelled_m)
        self._key_pose, self._key_t_s = self._pose, t_s
        self._key_covariance = _FULL_TRUST if is_new else covariance

    def _lose(
        self, points: ScanPoints, expected: "Expected", share: float, t_s: float, heading_rad: float | None
    ) -> LaserMotion:
        """Handles a scan that does not fit; after several, earlier data are dropped."""
        reason = f"only {100.0 * share:.0f} % of the scan fits into the map"
        if self._bad < MOST_FAILURES:
            return self._nothing(t_s, reason)
        return self._begin(points, self._pose @ expected.motion, t_s, heading_rad, f"{reason}: it restarts")

    # --- keeping books ---

    def _begin(
        self, points: ScanPoints, pose: Planar, t_s: float, heading_rad: float | None, reason: str
    ) -> LaserMotion:
        self._has_begun, self._velocity, self._travelled_m = True, None, 0.0
        self._settle(pose, t_s, heading_rad)
        self._add_scan(points, t_s, _FULL_TRUST, is_new=True)
        return self._nothing(t_s, reason)

    def _settle(self, pose: Planar, t_s: float, heading_rad: float | None) -> None:
        self._pose, self._t_s, self._heading_rad = pose, t_s, heading_rad
        self._reported, self._bad = Planar(), -1

    def _nothing(self, t_s: float, reason: str) -> LaserMotion:
        """No motion; the pose is the given one, or that of the last good scan."""
        self._bad += 1
        pose = self._pose @ (self._reported or Planar())
        return LaserMotion(
            t_s=t_s,
            reference_t_s=self._key_t_s,
            motion=self._key_pose.inverse() @ pose,
            covariance=UNKNOWN_VARIANCE * np.eye(3),
            pose=pose,
            is_valid=False,
            reason=reason,
            quality=0.0,
        )


class Expected(NamedTuple):
    """The motion that is expected since the last good scan."""

    motion: Planar
    window: SearchWindow | None
    """How wrong that may be; None before the first scan."""


def _between(height_m: float | None, before_m: float | None) -> float:
    """The climb from one height to another; 0 where one of them is not known."""
    return 0.0 if height_m is None or before_m is None else height_m - before_m


def _since(key: Planar, key_covariance: Array, pose: Planar, covariance: Array) -> Array:
    """Covariance of a pose relative to another with independent errors, on the other's axes."""
    x, y = pose.x_m - key.x_m, pose.y_m - key.y_m
    # C = R^T (C_pose + L C_key L^T) R, R the key's axes; L carries its heading error over the distance.
    lever = np.array(((1.0, 0.0, -y), (0.0, 1.0, x), (0.0, 0.0, 1.0)))
    turn = np.eye(3)
    turn[:2, :2] = key.rotation().T
    result: Array = turn @ (covariance + lever @ key_covariance @ lever.T) @ turn.T
    return result
