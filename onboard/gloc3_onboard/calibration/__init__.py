"""Calibration files of cameras: OpenCV, Kalibr, EuRoC and KITTI, one reader a file, all into one camera model."""
