"""The map of a drive that `gloc3 odometry laser --map` writes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.errors import Refused
from gloc3.terrain import write_map
from gloc3_onboard.algorithms.mapping.occupancy import OccupancyStack
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserMotion
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_graph import ScanGraph, poses_of_all
from gloc3_onboard.algorithms.scan_matching.scan_points import FEWEST_BEAMS, Mount, ScanPoints, Tilt, points_of
from gloc3_onboard.datasets.laser_log import LaserLog

CELL_M: Final = 0.05
RANGE_M: Final = 15.0
"""Hits farther away are left out of the map."""
LARGEST_M: Final = 400.0
DRAWN: Final = 1200
"""Scans that are drawn into the map, at most."""
LEVEL_M: Final = 0.5
"""Height of the drawn layer, whatever it was."""


def check_map_path(path: Path) -> None:
    """Checks the path before a long run.

    Raises:
        Refused: it does not end in .yaml, is there already, or cannot be written there.
    """
    if path.suffix != ".yaml":
        raise Refused(f"--map {path}: the name of the map ends in .yaml; its image comes beside it")
    if path.exists():
        raise Refused(f"--map {path}: it exists already; choose another name")
    if not path.absolute().parent.is_dir():
        raise Refused(f"--map {path}: there is no folder {path.parent}")


def laid_out(log: LaserLog, motions: Sequence[LaserMotion]) -> tuple[list[Planar], ScanGraph]:
    """Poses of all scans of a drive, after its loops are closed; and the graph that found them."""
    graph, was_valid = ScanGraph(), True
    for number, motion in enumerate(motions):
        points = _points(log, number)
        if number and not motion.is_valid:
            was_valid = False
        elif len(points.points_m) >= FEWEST_BEAMS:
            is_known = was_valid and not motion.is_degenerate and not motion.alternatives
            graph.add(number, points, motion.pose, is_sure=is_known)
            was_valid = True
    poses = graph.lay_out()
    return poses_of_all([motion.pose for motion in motions], graph.keys, poses), graph


def draw_map(log: LaserLog, poses: Sequence[Planar], path: Path) -> None:
    """Writes the occupancy map of a drive; north is ahead of the first scan."""
    stack = OccupancyStack(CELL_M, 2.0 * LEVEL_M, LARGEST_M, 1)
    for number in range(0, len(poses), max(1, len(poses) // DRAWN)):
        points, pose = _points(log, number), poses[number]
        hits = np.column_stack((pose.apply(points.points_m), np.full(len(points.points_m), -LEVEL_M)))
        stack.add_scan((pose.x_m, pose.y_m, -LEVEL_M), hits, round(2.0 * np.pi / points.step_rad), RANGE_M)
    write_map(path, stack.message(LEVEL_M))


def _points(log: LaserLog, number: int) -> ScanPoints:
    return points_of(log.scans[number].scan, Tilt(), Mount(), Planar())
