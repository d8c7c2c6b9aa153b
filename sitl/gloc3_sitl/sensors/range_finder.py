"""Common part of range finders along the body's down axis: readings and faults."""

from collections.abc import Callable
from typing import ClassVar, Final

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import TrueMotion, Truth
from gloc3_sitl.sensors.readings import RangeReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

COSINE_MIN: Final = 0.5
"""There is no echo from a floor that is tilted by more than 60 degrees."""
NO_ECHO_M: Final = -1.0
"""Distance that no device reports: no echo, m."""

Probe = Callable[[Truth, float], float]
"""Distance along the body's down axis to the first obstacle, from a point below the centre of gravity; infinity for
none."""


def upright(truth: Truth) -> float:
    """Cosine of the angle between the body's down axis and the vertical."""
    _, x, y, _ = truth.attitude_wxyz
    return 1.0 - 2.0 * (x * x + y * y)


def level_ground(truth: Truth, below_m: float) -> float:
    """The distance over level ground."""
    return (truth.height_above_ground_m + truth.standing_height_m) / upright(truth) - below_m


class RangeFinder(SimulatedSensor[RangeReading]):
    """A single-beam range finder; subclasses define its errors.

    Args:
        seed: of the noise.
        rate_hz: readings per second.
        probe: measures the true distance along the beam, slopes and boxes included.
    """

    name = "height"
    fault_unit = "m"
    bias_size = 1.0
    noise_size = 0.5
    min_m: ClassVar[float]
    """Shortest range."""
    max_m: ClassVar[float]
    """Longest range."""
    mount_height_m: ClassVar[float] = 0.0
    """Height over the ground when the vehicle stands level."""

    def __init__(self, seed: int, rate_hz: float, probe: Probe) -> None:
        super().__init__(seed, rate_hz)
        self._probe = probe

    def shift(self, reading: RangeReading, offset: Vector3) -> RangeReading:
        """Add metres, if there is an echo."""
        return self._reading(reading.t_s, reading.distance_m + offset[0]) if reading.is_valid else reading

    def scale(self, reading: RangeReading, factor: float) -> RangeReading:
        """Times a factor, if there is an echo: a speed of sound that is wrong."""
        return self._reading(reading.t_s, reading.distance_m * factor) if reading.is_valid else reading

    def without_signal(self, reading: RangeReading) -> RangeReading:
        """No echo."""
        return self._reading(reading.t_s, NO_ECHO_M)

    def _reading(self, t_s: float, distance_m: float) -> RangeReading:
        is_valid = self.min_m <= distance_m <= self.max_m
        return RangeReading(
            t_s=t_s,
            distance_m=distance_m if is_valid else 0.0,
            is_valid=is_valid,
            min_m=self.min_m,
            max_m=self.max_m,
            mount_height_m=self.mount_height_m,
        )


RESOLUTION: Final = 0.005
"""Deviation as a share of the range; the Ping1D class resolves 0.5 % of it."""


class Altimeter(RangeFinder):
    """Noise that grows with the range; no echo out of range or with a large tilt. The ranges are those of the Ping1D class."""

    min_m = 0.3
    max_m = 100.0

    def __init__(self, seed: int, rate_hz: float = 10.0, probe: Probe = level_ground) -> None:
        super().__init__(seed, rate_hz, probe)

    def measure(self, motion: TrueMotion, t_s: float) -> RangeReading:
        """Distance along the beam to the floor or an object on it."""
        truth = motion.truth()
        if upright(truth) < COSINE_MIN:
            return self._reading(t_s, NO_ECHO_M)
        return self._reading(t_s, self._probe(truth, 0.0) * (1.0 + RESOLUTION * self._draw()))


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

    def measure(self, motion: TrueMotion, t_s: float) -> RangeReading:
        """Distance along the beam to the ground or an object on it."""
        truth = motion.truth()
        error_m = self._bias_m + NOISE_M * self._draw()
        if upright(truth) < COSINE_MIN:
            return self._reading(t_s, NO_ECHO_M)
        return self._reading(t_s, self._probe(truth, truth.standing_height_m - self.mount_height_m) + error_m)
