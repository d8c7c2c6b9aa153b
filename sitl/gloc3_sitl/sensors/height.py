"""The height sensor: a laser range finder that looks along the body's down axis."""

from collections.abc import Callable
from typing import Final

from gloc3.frames import Vector3
from gloc3_sitl.sensors.readings import RangeReading
from gloc3_sitl.sensors.sensor import Sensor
from gloc3_sitl.truth import Motion, Truth

NOISE_M: Final = 0.01
"""White noise; the LIDAR-Lite v3HP class states 1 cm of resolution."""
BIAS_M: Final = 0.01
"""Deviation of the constant error; that class states ±2.5 cm of accuracy."""
MIN_M: Final = 0.05
"""Shortest range of that class."""
MAX_M: Final = 40.0
"""Longest range of that class."""
MOUNT_HEIGHT_M: Final = 0.10
"""Height of the sensor over the ground when the vehicle stands level."""
COSINE_MIN: Final = 0.5
"""There is no echo from a floor that is tilted by more than 60 degrees."""


Probe = Callable[[Truth, float], float]
"""Distance along the body's down axis to what it meets, from so far below the centre of gravity; infinity for nothing."""


def level_ground(truth: Truth, below_m: float) -> float:
    """The distance over level ground."""
    _, x, y, _ = truth.attitude_wxyz
    cosine = 1.0 - 2.0 * (x * x + y * y)
    return (truth.height_above_ground_m + truth.standing_height_m) / cosine - below_m


class HeightSensor(Sensor[RangeReading]):
    """White noise and a constant error; no echo out of range or with a large tilt.

    Args:
        seed: of the noise.
        rate_hz: readings per second.
        probe: measures the true distance: slopes and boxes tell where the vehicle is over them, not below the centre.
    """

    name = "height"
    fault_unit = "m"
    bias_size = 1.0
    noise_size = 0.5

    def __init__(self, seed: int, rate_hz: float = 20.0, probe: Probe = level_ground) -> None:
        super().__init__(seed, rate_hz)
        self._probe = probe
        self._bias_m = BIAS_M * self._draw()

    def measure(self, motion: Motion, t_s: float) -> RangeReading:
        """Distance along the beam to the ground, or whatever stands on it."""
        truth = motion.truth()
        _, x, y, _ = truth.attitude_wxyz
        cosine = 1.0 - 2.0 * (x * x + y * y)
        error_m = self._bias_m + NOISE_M * self._draw()
        if cosine < COSINE_MIN:
            return _reading(t_s, -1.0)
        return _reading(t_s, self._probe(truth, truth.standing_height_m - MOUNT_HEIGHT_M) + error_m)

    def shift(self, reading: RangeReading, offset: Vector3) -> RangeReading:
        """Add to the distance, if there is an echo."""
        return _reading(reading.t_s, reading.distance_m + offset[0]) if reading.is_valid else reading

    def scale(self, reading: RangeReading, factor: float) -> RangeReading:
        """Times a factor, if there is an echo."""
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
        mount_height_m=MOUNT_HEIGHT_M,
    )
