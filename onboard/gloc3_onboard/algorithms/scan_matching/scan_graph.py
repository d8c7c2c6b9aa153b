"""A map of a whole drive: key scans, joined by matches with those beside them and, where the way returns, with old ones.

Runs after the drive, on what the odometer has found. Each key scan is matched with the ones before it and with the
scans of other times nearby; a pose graph then moves all of them to where they agree best.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from gloc3_onboard.algorithms.scan_matching.correlative import SearchWindow
from gloc3_onboard.algorithms.scan_matching.lines import Lines, lines_of
from gloc3_onboard.algorithms.scan_matching.local_map import LocalMap
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.point_to_line import Information, ScanAlignment, ScanSight, align, search
from gloc3_onboard.algorithms.scan_matching.pose_graph import PoseRelation, optimized
from gloc3_onboard.algorithms.scan_matching.scan_points import ScanPoints

KEY_M: Final = 0.4
KEY_RAD: Final = 0.3
"""Distance and turn after which a scan becomes a key scan."""
BESIDE: Final = 3
"""A key scan is matched with so many before it, one by one…"""
AROUND: Final = 2
"""…and each of these brings so many of its neighbours on either side, as one map."""
LOOP_AFTER_M: Final = 6.0
"""A key scan of so much way before is of another time."""
LOOP_M: Final = 4.0
"""Key scans of other times are matched from within this distance,"""
LOOP_SHARE: Final = 0.01
"""and this share of the way in between, by which the odometer may have drifted,"""
LOOP_MOST_M: Final = 8.0
"""at most this."""
LOOPS: Final = 3
"""So many loops are closed from one key scan, to places that lie apart…"""
APART_M: Final = 1.5
"""…by so much of the way."""
ROUNDS: Final = 3
"""Better poses let more loops be found."""
SHARE: Final = 0.5
"""Share of a scan that must fit where a loop is closed…"""
CONTRADICTED: Final = 0.2
"""…and of the walls in view through which it may see."""
CAUTION: Final = 2.0
"""Residuals of neighbouring beams are alike: errors are larger than they suggest."""
FLOOR: Final = np.array((0.005, 0.005, 0.002)) ** 2
"""No match is better than this."""
DRIFT: Final = np.array((0.05, 0.05, 0.03)) ** 2
"""Errors of the odometer from key scan to key scan,"""
ASTRAY: Final = np.array((1.0, 1.0, 0.5)) ** 2
"""and where it was lost, or a direction was unknown to it."""
TRUSTED: Final = 0.3
"""Closed loops with less weight than this in the end are dropped."""


class KeyScan(NamedTuple):
    """A scan of which the map is made."""

    number: int
    """Among all scans."""
    points: ScanPoints
    lines: Lines
    travelled_m: float


class ScanGraph:
    """Collects key scans on the way, and lays them out afterwards."""

    def __init__(self) -> None:
        self.keys: list[KeyScan] = []
        self.relations: list[PoseRelation] = []
        self.loops = 0
        """Loops that have been closed."""
        self._found: list[Planar] = []
        """By the odometer."""
        self._is_astray = False
        self._poses: list[Planar] = []

    def add(self, number: int, points: ScanPoints, pose: Planar, *, is_sure: bool) -> None:
        """Adds a scan of the drive; it becomes a key scan where the way has gone on.

        Args:
            number: of the scan.
            points: its points.
            pose: of the body, by the odometer.
            is_sure: whether the odometer knows the motion since the scan before.
        """
        self._is_astray |= not is_sure
        if self._found:
            step = self._found[-1].inverse() @ pose
            if step.distance_m < KEY_M and abs(step.yaw_rad) < KEY_RAD:
                return
            spread = ASTRAY if self._is_astray else DRIFT
            last = len(self._found) - 1
            self.relations.append(PoseRelation(last, last + 1, step, np.diag(1.0 / spread)))
        travelled_m = self.keys[-1].travelled_m + (self._found[-1].inverse() @ pose).distance_m if self.keys else 0.0
        self.keys.append(KeyScan(number, points, lines_of(points), travelled_m))
        self._found.append(pose)
        self._is_astray = False

    def lay_out(self) -> list[Planar]:
        """Finds the poses of the key scans."""
        self._poses = list(self._found)
        if len(self._poses) < 2:
            return self._poses
        self.relations += self._beside()
        self._poses, _ = optimized(self._poses, self.relations)
        closed: dict[tuple[int, int], PoseRelation] = {}
        for _ in range(ROUNDS):
            before = len(closed)
            for loop in self._loops(closed):
                closed[loop.first, loop.second] = loop
            loops = list(closed.values())
            self._poses, weights = optimized(self._poses, self.relations + loops)
            trusts = weights[len(self.relations) :].tolist()
            closed = {(loop.first, loop.second): loop for loop, w in zip(loops, trusts, strict=True) if w >= TRUSTED}
            if len(closed) <= before:
                break
        self._poses, _ = optimized(self._poses, self.relations + list(closed.values()))
        self.loops = len(closed)
        return self._poses

    def _beside(self) -> Iterator[PoseRelation]:
        """Each key scan with the ones before it."""
        for second in range(1, len(self.keys)):
            for first in range(max(0, second - BESIDE), second):
                walls = self._walls(first, second)
                guess = self._poses[first].inverse() @ self._poses[second]
                found = align(self.keys[second].points.points_m, walls, guess, 0.3)
                if found.share >= SHARE:
                    yield _relation(first, second, found, is_certain=False)

    def _loops(self, closed: dict[tuple[int, int], PoseRelation]) -> Iterator[PoseRelation]:
        """Key scans with those of other times nearby."""
        places = np.array([(pose.x_m, pose.y_m) for pose in self._poses])
        along_m = np.array([key.travelled_m for key in self.keys])
        for second in range(len(self.keys)):
            between_m = along_m[second] - along_m[:second]
            away_m = np.hypot(*(places[:second] - places[second]).T)
            reach_m = np.minimum(LOOP_M + LOOP_SHARE * between_m, LOOP_MOST_M)
            near = np.flatnonzero((between_m > LOOP_AFTER_M) & (away_m < reach_m))
            chosen: list[int] = []
            for first in near[np.argsort(away_m[near], kind="stable")].tolist():
                if len(chosen) == LOOPS:
                    break
                if all(abs(along_m[first] - along_m[other]) > APART_M for other in chosen):
                    chosen.append(first)
            for first in chosen:
                if (first, second) not in closed and (loop := self._loop(first, second)) is not None:
                    yield loop

    def _loop(self, first: int, second: int) -> PoseRelation | None:
        """A key scan in the walls around another, if it fits there and nowhere else."""
        points = self.keys[second].points.points_m
        walls = self._walls(first, second)
        guess = self._poses[first].inverse() @ self._poses[second]
        between_m = self.keys[second].travelled_m - self.keys[first].travelled_m
        window = SearchWindow(min(1.0 + 2.0 * LOOP_SHARE * between_m, 2.5), 0.5)
        found = search(points, walls, guess, window)
        best = found[0]
        if len(found) > 1 or best.share < SHARE or ScanSight(points).contradicted(best.pose, walls) > CONTRADICTED:
            return None
        return _relation(first, second, best, is_certain=False)

    def _walls(self, center: int, without: int) -> LocalMap:
        """The walls around a key scan, on its axes, by it and its neighbours."""
        walls, back = LocalMap(1e9), self._poses[center].inverse()
        walls.add(self.keys[center].lines, Planar(), 0.0)
        for other in range(max(0, center - AROUND), min(len(self.keys), center + AROUND + 1)):
            if other not in (center, without):
                walls.add(self.keys[other].lines, back @ self._poses[other], 0.0)
        return walls


def _relation(first: int, second: int, found: ScanAlignment, *, is_certain: bool) -> PoseRelation:
    return PoseRelation(first, second, found.pose, _information(found.information), is_certain)


def _information(information: Information) -> Array:
    """Inverse covariance along what the walls determine, with caution; none along the rest."""
    known = information.known
    if not known.size:
        return np.zeros((3, 3))
    covariance = np.linalg.inv(known.T @ information.matrix @ known) * (CAUTION * information.sigma_m) ** 2
    covariance += known.T @ np.diag(FLOOR) @ known
    result: Array = known @ np.linalg.inv(covariance) @ known.T
    return result


def poses_of_all(odometry: Sequence[Planar], keys: Sequence[KeyScan], poses: Sequence[Planar]) -> list[Planar]:
    """The poses of all scans: each moves with the key scan before it."""
    found: list[Planar] = []
    last = 0
    for number, pose in enumerate(odometry):
        while last + 1 < len(keys) and keys[last + 1].number <= number:
            last += 1
        found.append(poses[last] @ (odometry[keys[last].number].inverse() @ pose))
    return found
