"""Local map of wall points seen lately, each kept as first seen."""

from typing import Final, NamedTuple

import numpy as np

from gloc3_onboard.algorithms.scan_matching.lines import Lines
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

SAME_M: Final = 0.05
"""Distance from a map point, along its line, within which a point is the same, m."""


class Neighbours(NamedTuple):
    """Nearest map point of each query point."""

    feet_m: Array
    normals: Array
    angle_std_rad: Array
    distance_m: Array
    """Infinite where nothing is near."""


class LocalMap:
    """Points on walls with the directions of these walls, in one frame; distant ones behind are dropped."""

    def __init__(self, reach_m: float) -> None:
        """Keeps walls seen from at most `reach_m` back along the path."""
        self._reach_m = reach_m
        self._feet = np.empty((0, 2))
        self._normals = np.empty((0, 2))
        self._std = np.empty(0)
        self._seen_m = np.empty(0)
        self._tree: object = None

    @property
    def feet_m(self) -> Array:
        """The points; shape (n, 2)."""
        return self._feet

    def add(self, lines: Lines, pose: Planar, travelled_m: float) -> None:
        """Adds the new points of a scan.

        Args:
            lines: wall pieces of the scan.
            pose: pose of the scan.
            travelled_m: length of path so far.
        """
        from scipy.spatial import cKDTree

        feet = pose.apply(lines.feet_m[lines.is_line])
        normals = lines.normals[lines.is_line] @ pose.rotation().T
        std = lines.angle_std_rad[lines.is_line]
        is_kept = self._seen_m >= travelled_m - self._reach_m
        if len(self._feet) and len(feet):
            near = self.neighbours(feet, 1.01 * SAME_M)
            off = np.abs(np.sum(near.normals * (feet - near.feet_m), axis=1))
            is_new = (near.distance_m > SAME_M) | (off > SAME_M)
            feet, normals, std = feet[is_new], normals[is_new], std[is_new]
        self._feet = np.concatenate((self._feet[is_kept], feet))
        self._normals = np.concatenate((self._normals[is_kept], normals))
        self._std = np.concatenate((self._std[is_kept], std))
        self._seen_m = np.concatenate((self._seen_m[is_kept], np.full(len(feet), travelled_m)))
        self._tree = cKDTree(self._feet, balanced_tree=False, compact_nodes=False)

    def neighbours(self, points: Array, within_m: float) -> Neighbours:
        """The nearest point of the map for each of some points; the map must not be empty."""
        distance, index = self._tree.query(points, distance_upper_bound=within_m)  # type: ignore[attr-defined]
        index = np.minimum(index, len(self._feet) - 1)
        return Neighbours(self._feet[index], self._normals[index], self._std[index], distance)
