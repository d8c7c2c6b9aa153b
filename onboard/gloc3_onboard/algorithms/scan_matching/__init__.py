"""Laser odometry: the motion of a range scanner from its scans alone.

`laser_odometer` is the estimator, `scan_graph` the map of a whole drive; the rest are their steps.
"""

__all__ = ["laser_odometer", "planar", "scan_graph", "scan_placement", "scan_points"]
