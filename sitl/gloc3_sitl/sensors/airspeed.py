"""The pitot tube: pressure of the air that flows in from ahead, as an air speed."""

from math import sqrt
from typing import Final

from gloc3.messages.frames import GeoPoint, Quaternion, Vector3, rotate_back
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.readings import AirspeedReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

_HALF_DENSITY: Final = 0.5 * 1.225
NOISE_PA: Final = 2.0
"""White noise of the difference of pressure, of the MS4525DO class after its filter."""
OFFSET_PA: Final = 2.0
"""Standard deviation of the constant error that remains after ground calibration, Pa."""
RATIO: Final = 0.01
"""Standard deviation of the scale error from the position of the tube in the flow, as a share."""


class Airspeed(SimulatedSensor[AirspeedReading]):
    """Airspeed from a differential pressure with noise and offset; coarse at low speeds.

    Args:
        seed: of the errors.
        home: location that selects the air of the standard atmosphere.
        rate_hz: readings per second.
    """

    name = "airspeed"
    fault_unit = "m/s"
    bias_size = 5.0
    noise_size = 3.0

    def __init__(self, seed: int, home: GeoPoint, rate_hz: float = 50.0) -> None:
        super().__init__(seed, rate_hz)
        self._offset_pa = OFFSET_PA * self._draw()
        density = (1.0 - 2.25577e-5 * home.altitude_m) ** 4.2559
        self._ratio = density * (1.0 + RATIO * self._draw())

    def measure(self, motion: TrueMotion, t_s: float) -> AirspeedReading:
        """The pressure ahead, with all errors."""
        truth = motion.truth()
        ahead = _ahead_m_s(truth.attitude_wxyz, truth.velocity_ned_m_s, truth.wind_ned_m_s)
        pressure_pa = _HALF_DENSITY * self._ratio * ahead * ahead + self._offset_pa + NOISE_PA * self._draw()
        return AirspeedReading(t_s=t_s, airspeed_m_s=sqrt(max(0.0, pressure_pa) / _HALF_DENSITY))

    def shift(self, reading: AirspeedReading, offset: Vector3) -> AirspeedReading:
        """Add metres per second."""
        return AirspeedReading(t_s=reading.t_s, airspeed_m_s=max(0.0, reading.airspeed_m_s + offset[0]))

    def scale(self, reading: AirspeedReading, factor: float) -> AirspeedReading:
        """A tube that is half closed."""
        return AirspeedReading(t_s=reading.t_s, airspeed_m_s=reading.airspeed_m_s * factor)


def _ahead_m_s(ned_from_frd: Quaternion, velocity_ned_m_s: Vector3, wind_ned_m_s: Vector3) -> float:
    """Speed of the air from ahead; 0 where it comes from behind."""
    n, e, d = (v - w for v, w in zip(velocity_ned_m_s, wind_ned_m_s, strict=True))
    return max(0.0, rotate_back(ned_from_frd, (n, e, d))[0])
