"""Rendered sequences as data sets in the forms that others use: KITTI odometry, EuRoC, CARMEN."""
