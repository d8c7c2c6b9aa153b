"""The barometer: pressure of the standard atmosphere, with noise, drift and the day's weather."""

from typing import Final

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.noise import Wander
from gloc3_sitl.sensors.readings import BarometerReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

NOISE_PA: Final = 1.2
"""White noise: 0.012 mbar at the highest oversampling (data sheet figure of the MS5611 class), 0.1 m of altitude."""
DRIFT_PA: Final = 4.0
"""Deviation of the drift with temperature and weather during a flight: 0.33 m of altitude."""
DRIFT_TIME_CONSTANT_S: Final = 600.0
"""Correlation time of the drift, s."""
WEATHER_PA: Final = 300.0
"""Deviation of the day's pressure from the standard atmosphere's, constant for a flight: 25 m of altitude."""

_SEA_LEVEL_PA: Final = 101_325.0
_LAPSE_PER_M: Final = 0.0065 / 288.15
_EXPONENT: Final = 5.25588


def pressure_pa(altitude_m: float) -> float:
    """Pressure of the standard atmosphere (ISO 2533) at an altitude in the troposphere."""
    return float(_SEA_LEVEL_PA * (1.0 - _LAPSE_PER_M * altitude_m) ** _EXPONENT)


def pressure_altitude_m(pressure: float) -> float:
    """Altitude at which the standard atmosphere has this pressure in pascals."""
    return float((1.0 - (max(pressure, 1.0) / _SEA_LEVEL_PA) ** (1.0 / _EXPONENT)) / _LAPSE_PER_M)


class Barometer(SimulatedSensor[BarometerReading]):
    """White noise, slow drift, and an offset of the day."""

    name = "barometer"
    fault_unit = "m"
    bias_size = 3.0
    noise_size = 2.0

    def __init__(self, seed: int, rate_hz: float = 25.0) -> None:
        super().__init__(seed, rate_hz)
        self._weather_pa = WEATHER_PA * self._draw()
        self._drift = Wander(self._draw, DRIFT_PA, DRIFT_TIME_CONSTANT_S, 1.0 / rate_hz)

    def measure(self, motion: TrueMotion, t_s: float) -> BarometerReading:
        """Pressure at the vehicle's altitude, with all errors."""
        error_pa = self._weather_pa + self._drift.step() + NOISE_PA * self._draw()
        pressure = pressure_pa(motion.truth().altitude_m) + error_pa
        return BarometerReading(t_s=t_s, pressure_pa=pressure, altitude_m=pressure_altitude_m(pressure))

    def shift(self, reading: BarometerReading, offset: Vector3) -> BarometerReading:
        """Add metres of altitude."""
        altitude_m = reading.altitude_m + offset[0]
        return BarometerReading(t_s=reading.t_s, pressure_pa=pressure_pa(altitude_m), altitude_m=altitude_m)
