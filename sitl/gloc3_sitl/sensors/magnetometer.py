"""The magnetometer: the Earth's field at the home, seen from the body, with noise and a leftover bias."""

from typing import Final

from gloc3.messages.frames import GeoPoint, Vector3, rotate_back
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.magnetic_field import field_ned_tesla
from gloc3_sitl.sensors.readings import MagnetometerReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

NOISE_TESLA: Final = 3e-7
"""White noise: 3 mG, data sheet figure of the HMC5983 and IST8310 class."""
BIAS_TESLA: Final = 4e-7
"""Standard deviation of the residual vehicle field after calibration, T: about a degree of heading."""


class Magnetometer(SimulatedSensor[MagnetometerReading]):
    """White noise and a bias that is constant for a flight."""

    name = "magnetometer"
    fault_unit = "T"
    bias_size = 1e-5
    noise_size = 5e-6

    def __init__(
        self,
        seed: int,
        home: GeoPoint,
        rate_hz: float = 25.0,
        *,
        noise_tesla: float = NOISE_TESLA,
        bias_tesla: float = BIAS_TESLA,
    ) -> None:
        super().__init__(seed, rate_hz)
        self._noise_tesla = noise_tesla
        self._field_ned_tesla = field_ned_tesla(home)
        self._bias_tesla = tuple(bias_tesla * self._draw() for _ in range(3))

    def measure(self, motion: TrueMotion, t_s: float) -> MagnetometerReading:
        """Turn the field into the body's axes and add the errors."""
        x, y, z = rotate_back(motion.truth().attitude_wxyz, self._field_ned_tesla)
        bx, by, bz = self._bias_tesla
        draw, noise = self._draw, self._noise_tesla
        field = (x + bx + noise * draw(), y + by + noise * draw(), z + bz + noise * draw())
        return MagnetometerReading(t_s=t_s, field_frd_tesla=field)

    def shift(self, reading: MagnetometerReading, offset: Vector3) -> MagnetometerReading:
        """Add to the field."""
        x, y, z = reading.field_frd_tesla
        return MagnetometerReading(t_s=reading.t_s, field_frd_tesla=(x + offset[0], y + offset[1], z + offset[2]))
