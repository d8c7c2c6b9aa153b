"""Calibration files of cameras: OpenCV, Kalibr, EuRoC and KITTI, one reader a file, all into one camera model.

`reader` recognizes a file by its content; each format is a file. `rig_file` writes one.
"""

__all__ = ["mounting", "numbers", "reader", "rig_file"]
