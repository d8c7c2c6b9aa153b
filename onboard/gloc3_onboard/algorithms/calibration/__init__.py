"""Calibration of sensors from measurements alone: cameras and pairs by boards, their place and time by motion, magnetometers.

Plain classes and functions. `boards` finds the targets; each of the others makes one kind of calibration, with its doubt.
"""

__all__ = [
    "boards",
    "camera_imu_fit",
    "coverage",
    "ellipsoid",
    "laser_imu_fit",
    "lens_fit",
    "stereo_fit",
]
