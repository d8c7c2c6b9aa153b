"""Coverage of a calibration: which parts of the picture, which tilts and which distances the views of a board have shown."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gloc3_onboard.algorithms.calibration.boards import BoardView, Floats

CELLS: Final = (8, 6)
"""Columns and rows of the parts of a picture."""
LEAST_SHARE: Final = 0.6
"""Of the parts, those that must have shown a corner of a board."""
LEAST_VIEWS: Final = 8
LEAST_TILT_DEG: Final = 25.0
"""Between the views most tilted to either side, about each of the picture's axes."""
NEW_TILT_DEG: Final = 8.0
NEW_DISTANCE: Final = 1.25
"""A tilt or a distance that differs so much from all others is new."""
AXES: Final = ("up and down", "left and right")


class BoardCoverage:
    """What has been shown so far.

    Args:
        size: width and height of the pictures.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.counts = np.zeros((CELLS[1], CELLS[0]), int)
        """Corners in each part of the picture, (rows, columns)."""
        self.tilts_deg: list[tuple[float, float]] = []
        """Of the boards' normals from the optical axis: down and right, one a view."""
        self.distances_m: list[float] = []

    def add(self, view: BoardView, pose: Floats) -> None:
        """Adds a view.

        Args:
            view: the board in the picture.
            pose: rotation vector and translation of `camera_from_board`, if only roughly.
        """
        self.counts += self.cells(view)
        self.tilts_deg.append(tilt_deg(pose))
        self.distances_m.append(float(np.linalg.norm(pose[3:])))

    def is_new(self, view: BoardView, pose: Floats) -> bool:
        """Whether a view shows what none before it has shown."""
        tilt, distance_m = tilt_deg(pose), float(np.linalg.norm(pose[3:]))
        return (
            bool((self.cells(view)[self.counts == 0] > 0).any())
            or all(math.dist(tilt, other) > NEW_TILT_DEG for other in self.tilts_deg)
            or all(not 1.0 / NEW_DISTANCE < distance_m / other < NEW_DISTANCE for other in self.distances_m)
        )

    def cells(self, view: BoardView) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        """Corners of a view in each part of the picture, (rows, columns)."""
        bounds = [np.linspace(-0.5, side - 0.5, count + 1) for side, count in zip(self.size, CELLS, strict=True)]
        counts, _, _ = np.histogram2d(view.pixels[:, 1], view.pixels[:, 0], bins=(bounds[1], bounds[0]))
        return counts.astype(np.int64)

    @property
    def share(self) -> float:
        """Share of the picture's parts that have shown a corner."""
        return float((self.counts > 0).mean())

    @property
    def spreads_deg(self) -> tuple[float, float]:
        """Between the views most tilted to either side: up and down, left and right."""
        if not self.tilts_deg:
            return 0.0, 0.0
        down, right = np.ptp(np.array(self.tilts_deg), axis=0).tolist()
        return down, right

    def lacks(self) -> list[str]:
        """What a calibration from these views would lack; empty if nothing."""
        found = []
        if len(self.tilts_deg) < LEAST_VIEWS:
            found.append(f"{len(self.tilts_deg)} pictures with a board, {LEAST_VIEWS} are the least")
        if self.share < LEAST_SHARE:
            found.append(f"boards have covered {self.share:.0%} of the picture, {LEAST_SHARE:.0%} is the least")
        for spread, axis in zip(self.spreads_deg, AXES, strict=True):
            if spread < LEAST_TILT_DEG:
                found.append(f"tilts {axis} are {spread:.0f} degrees apart, {LEAST_TILT_DEG:.0f} is the least")
        return found

    def advice(self) -> str:
        """What to show next; empty if enough has been shown."""
        down, right = self.spreads_deg
        if self.share < LEAST_SHARE:
            return f"hold the board in the {self._emptiest()} of the picture"
        if min(down, right) < LEAST_TILT_DEG:
            edge = "upper or lower edge" if down < right else "left or right edge"
            return f"tilt the board: bring its {edge} nearer to the camera"
        if len(self.tilts_deg) < LEAST_VIEWS:
            return "show the board from another distance"
        return ""

    def _emptiest(self) -> str:
        rows, columns = np.array_split(np.arange(CELLS[1]), 3), np.array_split(np.arange(CELLS[0]), 3)
        names = ("upper", "middle", "lower"), ("left", "centre", "right")
        empty = {
            (y, x): float((self.counts[np.ix_(rows[y], columns[x])] == 0).mean()) for y in range(3) for x in range(3)
        }
        y, x = max(empty, key=lambda place: empty[place])
        return f"{names[0][y]} {names[1][x]}"


def tilt_deg(pose: Floats) -> tuple[float, float]:
    """How a board's normal is turned from the optical axis: down and right, in degrees.

    Args:
        pose: rotation vector and translation of `camera_from_board`.
    """
    from scipy.spatial.transform import Rotation

    normal = Rotation.from_rotvec(pose[:3]).as_matrix()[:, 2]
    if normal[2] < 0.0:
        normal = -normal
    return math.degrees(math.atan2(normal[1], normal[2])), math.degrees(math.atan2(normal[0], normal[2]))


def covered(views: Sequence[BoardView], poses: Floats, size: tuple[int, int]) -> BoardCoverage:
    """The coverage of views with their poses."""
    coverage = BoardCoverage(size)
    for view, pose in zip(views, poses, strict=True):
        coverage.add(view, pose)
    return coverage
