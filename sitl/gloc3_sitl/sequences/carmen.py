"""Writes laser scans as a CARMEN log: `FLASER` lines with the true pose of the scanner."""

from collections.abc import Iterable
from math import atan2, pi
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.messages.frames import rotate
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.laser import LaserModel, LaserScanner

HALF_TURN: Final = LaserModel(
    beams=361, angle_min_rad=-pi / 2.0, angle_step_rad=pi / 360.0, range_max_m=30.0, noise_m=0.01
)
"""What such logs were taken with: half a turn from the right to the left, half a degree a beam."""
BEGIN_S: Final = 1_700_000_000.0


def write_carmen(
    path: Path, world: World, truths: Iterable[Truth], *, model: LaserModel = HALF_TURN, seed: int = 0
) -> int:
    """Writes a log with zero wheel odometry, for flying vehicles.

    Args:
        path: the file.
        world: scene to scan.
        truths: vehicle state at each scan.
        model: the scanner; readers of such logs assume a view of -90 to +90 degrees ahead.
        seed: of noise and drop-outs.

    Returns:
        The number of scans.
    """
    scanner = LaserScanner(world, model, seed)
    lines = ["# FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta t host logger_t"]
    for truth in truths:
        ranges = np.frombuffer(scanner.scan(truth).ranges_m, "<f4")
        place = scanner.pose(truth)
        ahead = rotate(place.local_from_here, (1.0, 0.0, 0.0))
        x, y, _ = place.position_m
        readings = " ".join(f"{value:.4f}" for value in ranges)
        pose = f"{x:.6f} {y:.6f} {atan2(ahead[1], ahead[0]):.7f}"
        stamp_s = BEGIN_S + truth.t_s
        lines.append(f"FLASER {len(ranges)} {readings} {pose} 0 0 0 {stamp_s:.6f} gloc3 {truth.t_s:.6f}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return len(lines) - 1
