"""Pose fusion: one pose from an IMU, odometers, an external tracker and a height, whichever are available.

`pose_fusion` is the estimator, `settings` what can be set; the rest are its parts.
"""

__all__ = ["inertial", "pose_fusion", "settings"]
