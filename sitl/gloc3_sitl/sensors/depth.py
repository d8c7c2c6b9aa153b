"""Depth sensor: water pressure, the counterpart of the barometer on diving vehicles."""

from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, GeoPoint, Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.noise import Wander
from gloc3_sitl.sensors.readings import BarometerReading, LeakReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

DENSITY_KG_M3: Final = 1025.0
"""Of sea water; the sensor's table has the same."""
SURFACE_PA: Final = 101_325.0
"""Pressure at the surface, Pa; the autopilot takes its own reference when it boots there."""
NOISE_M: Final = 0.002
"""White noise: the resolution of the Bar30 class (MS5837-30BA)."""
DRIFT_M: Final = 0.02
"""Deviation of the slow drift; that class states ±5 cm relative accuracy at constant temperature as typical."""
DRIFT_TIME_CONSTANT_S: Final = 600.0


class DepthSensor(SimulatedSensor[BarometerReading]):
    """White noise and a slow drift; depth counts from the calm surface at the home."""

    name = "barometer"
    fault_unit = "m"
    bias_size = 1.0
    noise_size = 0.5

    def __init__(self, seed: int, home: GeoPoint, rate_hz: float = 25.0) -> None:
        super().__init__(seed, rate_hz)
        self._surface_m = home.altitude_m
        self._drift = Wander(self._draw, DRIFT_M, DRIFT_TIME_CONSTANT_S, 1.0 / rate_hz)

    def measure(self, motion: TrueMotion, t_s: float) -> BarometerReading:
        """Pressure at the vehicle's depth, with all errors."""
        error_m = self._drift.step() + NOISE_M * self._draw()
        return self._reading(t_s, motion.truth().altitude_m - self._surface_m + error_m)

    def shift(self, reading: BarometerReading, offset: Vector3) -> BarometerReading:
        """Add metres of height."""
        return self._reading(reading.t_s, reading.altitude_m - self._surface_m + offset[0])

    def _reading(self, t_s: float, height_m: float) -> BarometerReading:
        pressure_pa = SURFACE_PA - DENSITY_KG_M3 * GRAVITY_M_S2 * height_m
        return BarometerReading(t_s=t_s, pressure_pa=pressure_pa, altitude_m=self._surface_m + height_m)


class LeakSensor(SimulatedSensor[LeakReading]):
    """Dry, until a fault says otherwise: `sensor:leak=biased`."""

    name = "leak"
    fault_unit = "no unit"
    bias_size = 1.0
    noise_size = 1.0

    def __init__(self, seed: int, rate_hz: float = 2.0) -> None:
        super().__init__(seed, rate_hz)

    def measure(self, motion: TrueMotion, t_s: float) -> LeakReading:
        """Dry."""
        del motion
        return LeakReading(t_s=t_s, is_wet=False)

    def shift(self, reading: LeakReading, offset: Vector3) -> LeakReading:
        """Wet, whatever the size."""
        return LeakReading(t_s=reading.t_s, is_wet=any(offset))
