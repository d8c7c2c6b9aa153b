"""Laser odometry: aligns each scan to a local map of the walls seen lately."""

from typing import Annotated, Final

import msgspec
import numpy as np

from gloc3.component.settings import Bounds
from gloc3.messages.frames import wrap_pi
from gloc3.messages.perception import UNKNOWN_VARIANCE, LaserScan
from gloc3_onboard.algorithms.scan_matching.correlative import SearchWindow
from gloc3_onboard.algorithms.scan_matching.lines import lines_of
from gloc3_onboard.algorithms.scan_matching.motion_model import LONGEST_S, Expected, MotionModelSettings
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.point_to_line import ScanAlignment, is_same_place, search
from gloc3_onboard.algorithms.scan_matching.scan_points import (
    FEWEST_BEAMS,
    Mount,
    ScanPoints,
    Tilt,
    fault_of,
    points_of,
)
from gloc3_onboard.algorithms.scan_matching.scan_track import FULL_TRUST, ScanTrack

LEVEL: Final = Tilt()
AT_BODY: Final = Mount()
MOST_FAILURES: Final = 5
"""Consecutive bad scans after which earlier data are dropped."""
CAUTION: Final = 1.8
"""Residuals of things that are no walls, such as tops of boxes, are alike: errors are larger than they suggest."""
DARK_S: Final = 2.0
MOST_TRACKS: Final = 3
REFUTED: Final = 0.4
"""Sum of the shares by which an alternative has fitted worse than the best one when it is dropped."""
UNDECIDED_S: Final = 5.0
"""Alternatives are kept for so long."""
RECOVERY_S: Final = 30.0
"""After a restart the map before it is searched for so long…"""
RECOVERY_SCANS: Final = 10
"""…with every so many scans…"""
RECOVERY_RAD: Final = 1.0
"""…and so far around the heading…"""
RECOVERY_CONTRADICTED: Final = 0.2
"""…and a place is believed of which no more than this share of the walls is seen through."""
LEAN: Final = 0.75
"""Tilt allowance of walls: uncertainty of their position at another height, as a share of the climb."""
LEVEL_M: Final = 0.03
"""Climb below which the height counts as constant, m; longer climbs count from their start."""
NEW_LEVEL_M: Final = 0.2
"""Climb after which the map restarts, m."""
_FLOOR: Final = np.diag((0.001**2, 0.001**2, 0.0002**2))
"""No fit is better than this: walls are not quite straight, nor is the clock of the scanner."""


class LaserOdometerSettings(MotionModelSettings, frozen=True):
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
    alternatives: int = 0
    """Other places where the body may be just as well; the covariance covers them."""


class LaserOdometer:
    """Estimates motion from scans. A bad scan yields an invalid motion with a reason, and changes nothing."""

    def __init__(self, settings: LaserOdometerSettings | None = None, mount: Mount = AT_BODY) -> None:
        self._settings = settings or LaserOdometerSettings()
        self._mount = mount
        self._has_begun = False
        self._tracks = [self._track(Planar())]
        """The accounts between which the scans have not decided, the best first."""
        self._undecided_s = 0.0
        """Since when there is more than one."""
        self._t_s = self._key_t_s = 0.0
        self._ranges = b""
        self._reported: Planar | None = Planar()
        self._heading_rad: float | None = None
        self._height_m: float | None = None
        """Reference height of climbs: follows the height of the motion's reference, `LEVEL_M` behind."""
        self._map_height_m: float | None = None
        """Of the scan that the map began with."""
        self._bad = 0
        self._former: _Former | None = None

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
            heading_rad: heading of the body, from any source with slow drift; only its change is used: to predict the
                pose, and to refuse matches that contradict it.
            guess: motion of the body since the previous call, on the axes of that time, if known; used the same way.

        Returns:
            The motion since the reference.
        """
        self._reported = self._reported @ guess if self._reported is not None and guess is not None else None
        fault = fault_of(scan) or self._fault_in_time(scan, t_s)
        if fault:
            return self._nothing(t_s, fault)
        expected = self._expected(self._tracks[0], t_s - self._t_s, heading_rad) if self._has_begun else None
        points = points_of(scan, tilt, self._mount, self._skew(scan.duration_s, t_s, expected, heading_rad))
        if len(points.points_m) < FEWEST_BEAMS:
            return self._nothing(t_s, "hardly anything of the scan is above the floor")
        self._ranges = scan.ranges_m
        if expected is None:
            self._height_m = self._map_height_m = tilt.height_m
            return self._begin(points, Planar(), t_s, heading_rad, "the map starts with this scan")
        found = self._fitted(points.points_m, t_s, heading_rad)
        if not found:
            return self._lose(points, expected, t_s, heading_rad)
        return self._adopt(points, self._recovered(points.points_m, found, t_s), t_s, heading_rad, tilt.height_m)

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

    def _expected(self, track: ScanTrack, duration_s: float, heading_rad: float | None) -> Expected:
        """The motion since the last good scan, and how wrong that may be."""
        turn_rad = None
        # After a scan that did not fit, a heading that has leapt is not believed any longer.
        if heading_rad is not None and self._heading_rad is not None and self._bad < 1:
            turn_rad = heading_rad - self._heading_rad
        return track.model.expected(duration_s, self._reported, turn_rad)

    def _skew(self, scan_s: float, t_s: float, expected: Expected | None, heading_rad: float | None) -> Planar:
        """Motion during a scan: that of the last one, which is smoother than the wheels'."""
        if expected is None or scan_s <= 0.0:
            return Planar()
        share = min(1.0, scan_s / (t_s - self._t_s))
        velocity = self._tracks[0].model.velocity
        if velocity is None:
            return expected.motion.part(share)
        before = velocity.part(min(scan_s, LONGEST_S))
        return before if heading_rad is None else Planar(before.x_m, before.y_m, share * expected.motion.yaw_rad)

    # --- what is found ---

    def _fitted(self, points: Array, t_s: float, heading_rad: float | None) -> list[tuple[ScanTrack, ScanAlignment]]:
        """Each account with the place of the scan in its map, the best first; without those that are refuted."""
        settings, duration_s = self._settings, t_s - self._t_s
        found: list[tuple[ScanTrack, ScanAlignment]] = []
        for track in self._tracks:
            expected = self._expected(track, duration_s, heading_rad)
            places = track.fits(points, expected, settings.good_share)
            found += [(track if place is places[0] else track.fork(), place) for place in places]
        found = [(track, place) for track, place in found if place.share >= settings.lowest_share]
        best = max((place.score for _, place in found), default=0.0)
        for track, place in found:
            track.behind += best - place.score
        found.sort(key=lambda pair: pair[0].behind)
        lead = found[0][0].behind if found else 0.0
        kept: list[tuple[ScanTrack, ScanAlignment]] = []
        for track, place in found[:MOST_TRACKS]:
            track.behind -= lead
            if track.behind < REFUTED and not any(is_same_place(place.pose, other.pose) for _, other in kept):
                kept.append((track, place))
        return kept

    def _recovered(
        self, points: Array, found: list[tuple[ScanTrack, ScanAlignment]], t_s: float
    ) -> list[tuple[ScanTrack, ScanAlignment]]:
        """The same, or the place of the scan in the map before the last restart, once it is seen again."""
        former, (track, place) = self._former, found[0]
        if former is None:
            return found
        former.scans += 1
        if t_s - former.lost_s > RECOVERY_S:
            self._former = None
        if former.scans % RECOVERY_SCANS:
            return found
        walls = former.track.walls
        again = search(points, walls, place.pose, SearchWindow(self._settings.search_m, RECOVERY_RAD))
        if (
            len(again) > 1
            or again[0].share < self._settings.good_share
            or again[0].contradicted > RECOVERY_CONTRADICTED
            or again[0].information.is_degenerate
        ):
            return found
        self._former, self._key_t_s = None, former.key_t_s
        # It has gone on in the meantime as the present account says.
        former.track.pose = again[0].pose @ place.pose.inverse() @ track.pose
        former.track.model = track.model
        return [(former.track, again[0])]

    def _adopt(
        self,
        points: ScanPoints,
        found: list[tuple[ScanTrack, ScanAlignment]],
        t_s: float,
        heading_rad: float | None,
        height_m: float | None,
    ) -> LaserMotion:
        for track, place in found:
            track.move(place, t_s - self._t_s)
        self._undecided_s = t_s if len(found) == 1 else self._undecided_s
        self._tracks = [track for track, _ in found]
        self._settle(t_s, heading_rad)
        track, best = found[0]
        climb_m = _between(height_m, self._height_m)
        covariance = self._covariance(best, climb_m)
        # Report relative to the key pose; a new key where it is far, poorly observed or badly covered.
        motion, settings = track.motion, self._settings
        report = LaserMotion(
            t_s=t_s,
            reference_t_s=self._key_t_s,
            motion=motion,
            covariance=_since(track.key_pose, track.key_covariance, track.pose, covariance) + _spread(self._tracks),
            pose=track.pose,
            quality=best.share,
            is_degenerate=best.information.is_degenerate,
            alternatives=len(found) - 1,
        )
        if t_s - self._undecided_s > UNDECIDED_S:
            self._tracks = self._tracks[:1]
        is_far = motion.distance_m > settings.key_distance_m or abs(motion.yaw_rad) > settings.key_turn_rad
        is_degenerate = best.information.is_degenerate
        has_climbed = abs(_between(height_m, self._map_height_m)) > NEW_LEVEL_M
        # Who does not know how far it has come may be far: the direction that is not known is only known so well.
        is_far |= is_degenerate and t_s - self._key_t_s > DARK_S
        is_uncovered = has_climbed or best.share < settings.key_share
        if is_far or is_uncovered:
            is_new = is_degenerate or has_climbed
            # While the scans have not decided, only what is needed is added: a map of one's own fits always.
            self._set_key(points if is_uncovered or len(found) == 1 else None, t_s, covariance, is_new=is_new)
            if height_m is not None:
                self._height_m = height_m - max(-LEVEL_M, min(climb_m, LEVEL_M))
                self._map_height_m = height_m if is_new or self._map_height_m is None else self._map_height_m
        return report

    def _covariance(self, found: ScanAlignment, climb_m: float) -> Array:
        """Covariance of a place in the map: of the fit, plus a floor, plus walls that lean where the height has changed."""
        information = found.information._replace(sigma_m=CAUTION * found.information.sigma_m)
        covariance = information.covariance(UNKNOWN_VARIANCE) + _FLOOR
        covariance[:2, :2] += max(0.0, LEAN * (abs(climb_m) - LEVEL_M)) ** 2 * np.eye(2)
        return covariance

    def _set_key(self, points: ScanPoints | None, t_s: float, covariance: Array, *, is_new: bool) -> None:
        """Makes the present place the reference, and a scan part of the map; or the begin of a new one.

        Along a direction that is not known, a scan cannot be put where it belongs in the map.
        """
        lines = lines_of(points) if points is not None else None
        for track in self._tracks:
            track.set_key(FULL_TRUST if is_new else covariance)
            if lines is not None:
                track.add_scan(lines, is_new=is_new)
        self._key_t_s = t_s

    def _lose(self, points: ScanPoints, expected: Expected, t_s: float, heading_rad: float | None) -> LaserMotion:
        """Handles a scan that does not fit; after several, earlier data are dropped."""
        reason = "the scan fits nowhere into the map where the body can be"
        if self._bad < MOST_FAILURES:
            return self._nothing(t_s, reason)
        lost = self._tracks[0]
        if self._former is None or lost.travelled_m > self._settings.key_distance_m:
            self._former = _Former(lost, self._key_t_s, t_s)
        return self._begin(points, lost.pose @ expected.motion, t_s, heading_rad, f"{reason}: it restarts")

    # --- keeping books ---

    def _track(self, pose: Planar) -> ScanTrack:
        return ScanTrack(pose, self._settings.reach_m, self._settings)

    def _begin(
        self, points: ScanPoints, pose: Planar, t_s: float, heading_rad: float | None, reason: str
    ) -> LaserMotion:
        self._has_begun, self._tracks, self._undecided_s = True, [self._track(pose)], t_s
        self._settle(t_s, heading_rad)
        self._set_key(points, t_s, FULL_TRUST, is_new=True)
        return self._nothing(t_s, reason)

    def _settle(self, t_s: float, heading_rad: float | None) -> None:
        self._t_s, self._heading_rad = t_s, heading_rad
        self._reported, self._bad = Planar(), -1

    def _nothing(self, t_s: float, reason: str) -> LaserMotion:
        """No motion; the pose is the given one, or that of the last good scan."""
        self._bad += 1
        track = self._tracks[0]
        pose = track.pose @ (self._reported or Planar())
        return LaserMotion(
            t_s=t_s,
            reference_t_s=self._key_t_s,
            motion=track.key_pose.inverse() @ pose,
            covariance=UNKNOWN_VARIANCE * np.eye(3),
            pose=pose,
            is_valid=False,
            reason=reason,
            quality=0.0,
        )


class _Former:
    """The account before the last restart."""

    __slots__ = ("key_t_s", "lost_s", "scans", "track")

    def __init__(self, track: ScanTrack, key_t_s: float, lost_s: float) -> None:
        self.track = track
        self.key_t_s = key_t_s
        self.lost_s = lost_s
        self.scans = 0
        """Scans since then."""


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


def _spread(tracks: list[ScanTrack]) -> Array:
    """What the motion since the key scan would be wrong by, were it not that of the first account."""
    motion, spread = tracks[0].motion, np.zeros((3, 3))
    for other in tracks[1:]:
        x, y, yaw = other.motion
        off = np.array((x - motion.x_m, y - motion.y_m, wrap_pi(yaw - motion.yaw_rad)))
        spread += np.outer(off, off)
    return spread
