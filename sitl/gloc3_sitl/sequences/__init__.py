"""Rendered sequences as data sets in common formats: KITTI odometry, EuRoC, CARMEN.

`gloc3 sitl record` writes them; the readers are in the onboard package.
"""

__all__ = ["carmen", "euroc", "ground", "kitti", "smooth_flight"]
