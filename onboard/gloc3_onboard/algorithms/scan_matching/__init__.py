"""Laser odometry: the motion of a range scanner from its scans alone.

`laser_odometer` is the estimator; the rest are its steps.
"""

__all__ = ["laser_odometer", "planar", "scan_placement", "scan_points"]
