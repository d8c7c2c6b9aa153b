"""An account of where the body is: its pose, its velocity, and the map and the key scan that belong to them."""

from copy import copy
from typing import Final

import numpy as np

from gloc3_onboard.algorithms.scan_matching.lines import Lines
from gloc3_onboard.algorithms.scan_matching.local_map import LocalMap
from gloc3_onboard.algorithms.scan_matching.motion_model import Expected, MotionModel, MotionModelSettings
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.point_to_line import (
    BETTER,
    NEAR_M,
    ScanAlignment,
    align,
    is_same_place,
    search,
)

SURE_M: Final = 0.25
SURE_RAD: Final = 0.15
"""A scan that lies no farther from where it is expected is fitted at once, without a search."""
UNUSUAL: Final = 0.1
"""A scan that fits by so much less than the ones before is searched for all around."""
MEMORY: Final = 0.9
"""Weight of the scans before, in what is usual."""
FULL_TRUST: Final = np.zeros((3, 3))


class ScanTrack:
    """One account of where the body is.

    Args:
        pose: of the body, on the axes of the first scan.
        reach_m: length of path whose walls the map holds.
        settings: how the body can move.
    """

    __slots__ = (
        "_reach_m",
        "behind",
        "key_covariance",
        "key_pose",
        "model",
        "pose",
        "travelled_m",
        "usual_share",
        "walls",
    )

    def __init__(self, pose: Planar, reach_m: float, settings: MotionModelSettings) -> None:
        self._reach_m = reach_m
        self.pose = pose
        self.model = MotionModel(settings)
        self.walls = LocalMap(reach_m)
        self.travelled_m = 0.0
        self.key_pose = pose
        self.key_covariance: Array = FULL_TRUST
        self.usual_share = 0.0
        """Share of a scan that fits, of late."""
        self.behind = 0.0
        """Sum of the shares by which its scans have fitted worse than those of the best account."""

    @property
    def motion(self) -> Planar:
        """The motion since the key scan."""
        return self.key_pose.inverse() @ self.pose

    def fork(self) -> "ScanTrack":
        """Another account with the same past."""
        other = copy(self)
        other.model, other.walls = copy(self.model), copy(self.walls)
        return other

    def fits(self, points: Array, expected: Expected, good_share: float) -> list[ScanAlignment]:
        """Plausible places of a scan, the best first; more than one where they fit about as well.

        Near the expected place if that is well known, else, or if it does not fit there, all around it.
        """
        guess, window = self.pose @ expected.motion, expected.window
        # Local alignment where the window is small; else, or where it fits badly, correlative search.
        is_sure = window.distance_m <= SURE_M and window.heading_rad <= SURE_RAD
        near = align(points, self.walls, guess, window.distance_m + NEAR_M) if is_sure else None
        if near is not None and not expected.allows(self.pose.inverse() @ near.pose):
            near = None
        good_share = max(good_share, self.usual_share - UNUSUAL)
        if near is not None and near.share >= good_share:
            return [near]
        wide = window._replace(distance_m=max(window.distance_m, SURE_M), heading_rad=max(window.heading_rad, SURE_RAD))
        found = [
            place
            for place in search(points, self.walls, guess, wide, good_share, expected.prior)
            if expected.allows(self.pose.inverse() @ place.pose)
        ]
        if near is None or (found and found[0].score > near.share + BETTER):
            return found
        return [near, *(place for place in found if not is_same_place(place.pose, near.pose))]

    def move(self, place: ScanAlignment, duration_s: float) -> None:
        """Goes to where a scan fits."""
        pose = place.pose
        self.usual_share = MEMORY * self.usual_share + (1.0 - MEMORY) * place.share
        step = self.pose.inverse() @ pose
        self.model.update(step, duration_s)
        self.travelled_m += step.distance_m
        self.pose = pose

    def set_key(self, covariance: Array) -> None:
        """Makes the present pose the reference."""
        self.key_pose, self.key_covariance = self.pose, covariance

    def add_scan(self, lines: Lines, *, is_new: bool) -> None:
        """Makes the present scan part of the map; or the begin of a new one."""
        if is_new:
            self.walls = LocalMap(self._reach_m)
        self.walls.add(lines, self.pose, self.travelled_m)
