"""Cameras, lenses, depth camera and laser scanners of the example vehicles.

The platform files name the same calibration; a real vehicle brings its own files.
"""

from math import pi
from typing import Final

from gloc3.camera.model import CameraModel, Lens
from gloc3.messages.frames import from_euler
from gloc3_sitl.world.depth_camera import DepthImager
from gloc3_sitl.world.imager import Imager
from gloc3_sitl.world.laser import LaserModel, LidarModel

BASELINE_M: Final = 0.15
"""Between the two eyes of the stereo pair."""

GROUND: Final = CameraModel(
    width=640,
    height=480,
    focal_px=(400.0, 400.0),
    center_px=(319.5, 239.5),
    position_frd_m=(0.0, 0.0, 0.07),
    frd_from_rdf=from_euler(0.0, 0.0, pi / 2.0),
)
"""Downward camera; the top of its picture is ahead; 77 by 62 degrees, no distortion."""
GROUND_IMAGER: Final = Imager(name="ground")

FRONT_LEFT: Final = CameraModel(
    width=640,
    height=480,
    focal_px=(430.0, 430.0),
    center_px=(321.3, 238.1),
    lens=Lens.RADTAN,
    distortion=(-0.11, 0.035, 0.0004, -0.0003),
    position_frd_m=(0.12, -BASELINE_M / 2.0, 0.02),
)
"""Left camera of the forward stereo pair, 80 degrees wide."""
FRONT_RIGHT: Final = CameraModel(
    width=640,
    height=480,
    focal_px=(431.5, 431.5),
    center_px=(318.2, 240.6),
    lens=Lens.RADTAN,
    distortion=(-0.108, 0.033, -0.0002, 0.0003),
    position_frd_m=(0.12, BASELINE_M / 2.0, 0.02),
)
"""The right eye."""
FRONT_LEFT_IMAGER: Final = Imager(name="front_left")
FRONT_RIGHT_IMAGER: Final = Imager(name="front_right")

GIMBAL: Final = CameraModel(width=640, height=480, focal_px=(500.0, 500.0), center_px=(319.5, 239.5))
"""Camera on the gimbal of vehicles that have one: 65 by 51 degrees, no distortion; it looks ahead along the gimbal."""
GIMBAL_IMAGER: Final = Imager(name="gimbal")

CAMERAS: Final = {
    imager.name: (model, imager)
    for model, imager in (
        (GROUND, GROUND_IMAGER),
        (FRONT_LEFT, FRONT_LEFT_IMAGER),
        (FRONT_RIGHT, FRONT_RIGHT_IMAGER),
    )
}
"""All cameras of the vehicle, by name."""

TRACKER: Final = CameraModel(
    width=640,
    height=480,
    focal_px=(330.0, 330.0),
    center_px=(318.7, 241.2),
    lens=Lens.RADTAN,
    distortion=(-0.06, 0.012, 0.0003, 0.0002),
)
"""The external tracker's camera: 88 by 72 degrees, with which it sees a whole hold from a corner."""
TRACKER_IMAGER: Final = Imager(name="tracker", noise_grey=2.5, sensitivity=0.25)

LASER: Final = LaserModel()
"""Laser scanner on top of the vehicle: full turn, 1 degree, 30 m, 10 mm."""

LIDAR: Final = LidarModel()
"""3D scanner on top of the vehicle: 16 beams from 15 degrees below to 15 above, 30 m, 20 mm."""

DEPTH: Final = CameraModel(
    width=160, height=90, focal_px=(84.0, 84.0), center_px=(79.5, 44.5), position_frd_m=(0.12, 0.0, -0.02)
)
"""Forward depth camera: 87 by 56 degrees, no distortion, every fifth pixel of a real one."""
DEPTH_IMAGER: Final = DepthImager()
