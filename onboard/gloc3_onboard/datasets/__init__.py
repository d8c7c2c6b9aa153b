"""Readers of recorded data sets.

`laser_logs` and `stereo_set` open whatever form they find.
"""

__all__ = ["ground_folder", "laser_log", "laser_logs", "stereo_set"]
