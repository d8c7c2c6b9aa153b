"""Measures of flights and odometers: trajectories, their errors, and the path that was requested.

The figures are those of the field (absolute and relative trajectory error).
"""

__all__ = ["metrics", "requested_path", "trajectory"]
