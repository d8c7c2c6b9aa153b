"""Pose fusion: one pose from an IMU, odometers, an external tracker and a height, whichever are available.

`pose_fusion` is the estimator, `settings` its configuration; the other modules are its parts.
"""

__all__ = ["inertial", "pose_fusion", "settings"]
