"""Pose fusion: one pose from inertial measurements, odometers, an external tracker and a height, whichever are there.

`pose_fusion` is the estimator, `settings` what can be set; the rest are its parts.
"""

__all__ = ["inertial", "pose_fusion", "settings"]
