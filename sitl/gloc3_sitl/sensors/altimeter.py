"""The altimeter: an echo sounder that looks along the body's down axis."""

from typing import Final

from gloc3_sitl.physics.truth import Motion
from gloc3_sitl.sensors.range_finder import COSINE_MIN, NO_ECHO_M, Probe, RangeFinder, level_ground, upright
from gloc3_sitl.sensors.readings import RangeReading

RESOLUTION: Final = 0.005
"""Deviation as a share of the range; the Ping1D class resolves 0.5 % of it."""


class Altimeter(RangeFinder):
    """Noise that grows with the range; no echo out of range or with a large tilt. The ranges are those of the Ping1D class."""

    min_m = 0.3
    max_m = 100.0

    def __init__(self, seed: int, rate_hz: float = 10.0, probe: Probe = level_ground) -> None:
        super().__init__(seed, rate_hz, probe)

    def measure(self, motion: Motion, t_s: float) -> RangeReading:
        """Distance along the beam to the floor, or whatever stands on it."""
        truth = motion.truth()
        if upright(truth) < COSINE_MIN:
            return self._reading(t_s, NO_ECHO_M)
        return self._reading(t_s, self._probe(truth, 0.0) * (1.0 + RESOLUTION * self._draw()))
