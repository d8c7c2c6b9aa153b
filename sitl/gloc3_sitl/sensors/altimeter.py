"""The altimeter: an echo sounder that looks along the body's down axis."""

from typing import Final

from gloc3.frames import Vector3
from gloc3_sitl.sensors.height import COSINE_MIN, Probe, level_ground
from gloc3_sitl.sensors.readings import RangeReading
from gloc3_sitl.sensors.sensor import Sensor
from gloc3_sitl.truth import Motion

MIN_M: Final = 0.3
"""Shortest range of the Ping1D class."""
MAX_M: Final = 100.0
"""Longest range of that class."""
RESOLUTION: Final = 0.005
"""Deviation as a share of the range; that class resolves 0.5 % of it."""


class Altimeter(Sensor[RangeReading]):
    """Noise that grows with the range; no echo out of range or with a large tilt.

    Args:
        seed: of the noise.
        rate_hz: readings per second.
        probe: measures the true distance.
    """

    name = "height"
    fault_unit = "m"
    bias_size = 1.0
    noise_size = 0.5

    def __init__(self, seed: int, rate_hz: float = 10.0, probe: Probe = level_ground) -> None:
        super().__init__(seed, rate_hz)
        self._probe = probe

    def measure(self, motion: Motion, t_s: float) -> RangeReading:
        """Distance along the beam to the floor, or whatever stands on it."""
        truth = motion.truth()
        _, x, y, _ = truth.attitude_wxyz
        if 1.0 - 2.0 * (x * x + y * y) < COSINE_MIN:
            return _reading(t_s, -1.0)
        distance_m = self._probe(truth, 0.0)
        return _reading(t_s, distance_m * (1.0 + RESOLUTION * self._draw()))

    def shift(self, reading: RangeReading, offset: Vector3) -> RangeReading:
        """Add metres."""
        return _reading(reading.t_s, reading.distance_m + offset[0]) if reading.is_valid else reading

    def scale(self, reading: RangeReading, factor: float) -> RangeReading:
        """Times a factor: a speed of sound that is wrong."""
        return _reading(reading.t_s, reading.distance_m * factor) if reading.is_valid else reading

    def without_signal(self, reading: RangeReading) -> RangeReading:
        """No echo."""
        return _reading(reading.t_s, -1.0)


def _reading(t_s: float, distance_m: float) -> RangeReading:
    is_valid = MIN_M <= distance_m <= MAX_M
    return RangeReading(
        t_s=t_s,
        distance_m=distance_m if is_valid else 0.0,
        is_valid=is_valid,
        min_m=MIN_M,
        max_m=MAX_M,
        mount_height_m=0.0,
    )
