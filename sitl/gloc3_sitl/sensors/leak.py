"""The leak sensor: a pair of contacts in the hull; a fault of it is water on them."""

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import Motion
from gloc3_sitl.sensors.readings import LeakReading
from gloc3_sitl.sensors.sensor import Sensor


class LeakSensor(Sensor[LeakReading]):
    """Dry, until a fault says otherwise: `sensor:leak=biased`."""

    name = "leak"
    fault_unit = "no unit"
    bias_size = 1.0
    noise_size = 1.0

    def __init__(self, seed: int, rate_hz: float = 2.0) -> None:
        super().__init__(seed, rate_hz)

    def measure(self, motion: Motion, t_s: float) -> LeakReading:
        """Dry."""
        del motion
        return LeakReading(t_s=t_s, is_wet=False)

    def shift(self, reading: LeakReading, offset: Vector3) -> LeakReading:
        """Wet, whatever the size."""
        return LeakReading(t_s=reading.t_s, is_wet=any(offset))
