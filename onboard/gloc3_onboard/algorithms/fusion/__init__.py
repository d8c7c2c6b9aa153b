"""Pose fusion: one pose from inertial measurements, odometers, an external tracker and a height, whichever are there."""
