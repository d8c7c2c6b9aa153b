"""The height sensor: a laser range finder that looks along the body's down axis."""

from typing import Final

from gloc3_sitl.physics.truth import Motion
from gloc3_sitl.sensors.range_finder import COSINE_MIN, NO_ECHO_M, Probe, RangeFinder, level_ground, upright
from gloc3_sitl.sensors.readings import RangeReading

NOISE_M: Final = 0.01
"""White noise; the LIDAR-Lite v3HP class states 1 cm of resolution."""
BIAS_M: Final = 0.01
"""Deviation of the constant error; that class states ±2.5 cm of accuracy."""


class HeightSensor(RangeFinder):
    """White noise and a constant error; no echo out of range or with a large tilt. The ranges are those of that class."""

    min_m = 0.05
    max_m = 40.0
    mount_height_m = 0.10

    def __init__(self, seed: int, rate_hz: float = 20.0, probe: Probe = level_ground) -> None:
        super().__init__(seed, rate_hz, probe)
        self._bias_m = BIAS_M * self._draw()

    def measure(self, motion: Motion, t_s: float) -> RangeReading:
        """Distance along the beam to the ground, or whatever stands on it."""
        truth = motion.truth()
        error_m = self._bias_m + NOISE_M * self._draw()
        if upright(truth) < COSINE_MIN:
            return self._reading(t_s, NO_ECHO_M)
        return self._reading(t_s, self._probe(truth, truth.standing_height_m - self.mount_height_m) + error_m)
