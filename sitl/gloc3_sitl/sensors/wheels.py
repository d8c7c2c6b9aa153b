"""Wheel encoders: how far the rim of each wheel has turned, in whole ticks."""

from math import floor
from typing import Final

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.readings import WheelReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

RADIUS_SHARE: Final = 0.005
"""Standard deviation of a wheel's true radius relative to the nominal one (wear, load)."""


class WheelEncoders(SimulatedSensor[WheelReading]):
    """One for each side; each wheel has a constant error of its radius.

    Args:
        seed: of the errors.
        ticks_per_m: of the encoders.
        rate_hz: readings per second.
    """

    name = "wheels"
    fault_unit = "m"
    bias_size = 1.0
    noise_size = 0.05

    def __init__(self, seed: int, ticks_per_m: float, rate_hz: float = 20.0) -> None:
        super().__init__(seed, rate_hz)
        self._ticks_per_m = ticks_per_m
        self._scales = (1.0 + RADIUS_SHARE * self._draw(), 1.0 + RADIUS_SHARE * self._draw())

    def measure(self, motion: TrueMotion, t_s: float) -> WheelReading:
        """Counts ticks."""
        routes = zip(motion.truth().wheels_m, self._scales, strict=True)
        left, right = (
            floor(travelled_m * scale * self._ticks_per_m) / self._ticks_per_m for travelled_m, scale in routes
        )
        return WheelReading(t_s=t_s, distances_m=(left, right))

    def shift(self, reading: WheelReading, offset: Vector3) -> WheelReading:
        """Adds metres to the left and the right."""
        left, right = reading.distances_m
        return WheelReading(t_s=reading.t_s, distances_m=(left + offset[0], right + offset[1]))

    def scale(self, reading: WheelReading, factor: float) -> WheelReading:
        """Wheels of another radius."""
        left, right = reading.distances_m
        return WheelReading(t_s=reading.t_s, distances_m=(left * factor, right * factor))
