"""The satellite receiver of a vehicle that dives: fixes at the surface only, some time after it has come up."""

from typing import Final

from gloc3.messages.frames import GeoPoint
from gloc3_sitl.physics.truth import Motion
from gloc3_sitl.sensors.fix import PLAIN_GPS, FixSensor, Receiver
from gloc3_sitl.sensors.readings import FixReading

ANTENNA_M: Final = 0.25
"""Height of the antenna over the body's origin, on its mast."""
REACQUIRE_S: Final = 8.0
"""From the first moment out of the water to the first fix: a warm receiver's re-acquisition (1 s hot, 29 s cold on the NEO-M8N
class) on a wet antenna that waves wash over."""


class SurfaceFix(FixSensor):
    """No satellites while the antenna is under water, and for `REACQUIRE_S` after."""

    def __init__(self, seed: int, home: GeoPoint, receiver: Receiver = PLAIN_GPS, rate_hz: float = 5.0) -> None:
        super().__init__(seed, home, receiver, rate_hz)
        self._surface_m = home.altitude_m
        self._since_s = -REACQUIRE_S

    def measure(self, motion: Motion, t_s: float) -> FixReading:
        """Where the vehicle is, if the receiver can know."""
        reading = super().measure(motion, t_s)
        if motion.truth().altitude_m + ANTENNA_M < self._surface_m:
            self._since_s = t_s
        return reading if t_s - self._since_s >= REACQUIRE_S else self.without_signal(reading)
