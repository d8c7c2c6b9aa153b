"""Simulated estimator of another maker: visual-inertial odometry as a box that sends its pose, which drifts."""

from math import radians, sqrt
from typing import Final

from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3, from_yaw, multiply, rotate
from gloc3.messages.perception import EstimatorPose
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.noise import normals

RATE_HZ: Final = 30.0
SCALE: Final = 0.005
"""Deviation of the scale; 0.5 to 1 % of the way is what such devices promise (Intel T265 data sheet; OpenVINS on EuRoC)."""
WALK: Final = 0.004
"""Deviation of position after 1 m of way that is not the scale's, m; it grows with the root of the way."""
TURN_RAD: Final = radians(0.05)
"""The same of the heading, rad."""
NOISE_M: Final = 0.002
"""White noise of each axis, m."""


class EstimatorModel:
    """Axes that are level and turned anyhow, with the origin at the begin; scale constant for a flight, drift by way.

    Args:
        seed: of noise and constant errors.
    """

    def __init__(self, seed: int) -> None:
        self._draw = normals(seed, "estimator")
        self._scale = 1.0 + SCALE * self._draw()
        self._yaw_rad = self._draw()
        self._plane: TangentPlane | None = None
        self._before: Vector3 = (0.0, 0.0, 0.0)
        self._reckoned: Vector3 = (0.0, 0.0, 0.0)

    def measure(self, truth: Truth) -> EstimatorPose:
        """The pose of the centre of gravity, with all errors."""
        if self._plane is None:
            self._plane = TangentPlane(GeoPoint(truth.latitude_deg, truth.longitude_deg, truth.altitude_m))
        north, east, down = self._plane.ned_from_geo(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
        here = (north, east, down - truth.standing_height_m)
        moved = tuple(now - was for now, was in zip(here, self._before, strict=True))
        way_m = sqrt(sum(part * part for part in moved))
        self._before = here
        self._yaw_rad += TURN_RAD * sqrt(way_m) * self._draw()
        turn = from_yaw(self._yaw_rad)
        x, y, z = rotate(turn, (moved[0], moved[1], moved[2]))
        walk = WALK * sqrt(way_m)
        self._reckoned = (
            self._reckoned[0] + self._scale * x + walk * self._draw(),
            self._reckoned[1] + self._scale * y + walk * self._draw(),
            self._reckoned[2] + self._scale * z + walk * self._draw(),
        )
        x, y, z = (part + NOISE_M * self._draw() for part in self._reckoned)
        return EstimatorPose(position_m=(x, y, z), world_from_body=multiply(turn, truth.attitude_wxyz))
