"""Simulated Doppler velocity log: four beams that point down and outwards and must reach the floor."""

from math import cos, radians, sin, sqrt
from typing import Final

from gloc3.messages.frames import rotate_back
from gloc3.messages.perception import BottomVelocity
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.noise import normals

RATE_HZ: Final = 8.0
"""Of the A50 class: 4 to 15 Hz by altitude."""
NEAR_M, FAR_M = 0.05, 50.0
"""Altitudes at which that class has bottom lock (Water Linked A50 data sheet)."""
BEAM_RAD: Final = radians(22.5)
"""Angle of the beams from the vertical, rad."""
TILT_MAX_RAD: Final = radians(35.0)
"""With more tilt a beam misses the floor."""
NOISE_M_S: Final = 0.006
"""White noise of each horizontal axis at 1 m/s; the figure of merit of that class is a few millimetres per second."""
SCALE: Final = 0.001
"""Deviation of the scale: long-term accuracy of 0.1 % (A50 Performance)."""
MOUNT_RAD: Final = radians(0.15)
"""Standard deviation of the mounting angle after calibration, rad; our estimate."""


class DvlModel:
    """Scale error and mounting angle constant for a flight, white noise; no lock out of range, tilted or out of the water.

    Args:
        seed: of noise and constant errors.
    """

    def __init__(self, seed: int) -> None:
        self._draw = normals(seed, "dvl")
        self._scale = 1.0 + SCALE * self._draw()
        self._mount_rad = MOUNT_RAD * self._draw()

    def measure(self, truth: Truth) -> BottomVelocity:
        """The velocity over the floor, with all errors."""
        u, v, w = rotate_back(truth.attitude_wxyz, truth.velocity_ned_m_s)
        _, x, y, _ = truth.attitude_wxyz
        upright = 1.0 - 2.0 * (x * x + y * y)
        altitude_m = truth.height_above_ground_m
        noise = tuple(NOISE_M_S * self._draw() for _ in range(3))
        reach_m = altitude_m / max(
            0.1, upright * cos(BEAM_RAD) - sqrt(max(0.0, 1.0 - upright * upright)) * sin(BEAM_RAD)
        )
        if upright < cos(TILT_MAX_RAD) or not altitude_m >= NEAR_M or reach_m > FAR_M / cos(BEAM_RAD):
            return BottomVelocity(is_valid=False, reason="no bottom lock")
        cosine, sine = cos(self._mount_rad), sin(self._mount_rad)
        return BottomVelocity(
            velocity_frd_m_s=(
                self._scale * (cosine * u + sine * v) + noise[0],
                self._scale * (cosine * v - sine * u) + noise[1],
                self._scale * w + 0.5 * noise[2],
            ),
            std_m_s=NOISE_M_S,
            altitude_m=altitude_m,
        )
