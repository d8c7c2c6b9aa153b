"""The inertial measurement unit: three accelerometers and three gyros."""

from math import sqrt
from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.readings import ImuReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

GYRO_DENSITY_RAD_S_RTHZ: Final = 0.004 * 0.0174532925
"""Noise of a gyro: 0.004 °/s/√Hz (data sheet figure of the ICM-20602 class)."""
ACCELEROMETER_DENSITY_M_S2_RTHZ: Final = 300e-6 * GRAVITY_M_S2
"""Noise density of an accelerometer: three times the 100 µg/√Hz of the ICM-20602 class, for a well damped frame's
vibration."""
GYRO_BIAS_RAD_S: Final = 0.002
"""Standard deviation of a gyro's residual bias after its calibration at start, rad/s."""
ACCELEROMETER_BIAS_M_S2: Final = 0.03
"""Standard deviation of an accelerometer's residual bias after a six-position calibration, m/s2."""


class SimulatedImu(SimulatedSensor[ImuReading]):
    """White noise over the band up to half the rate, and a bias that is constant for a flight."""

    name = "imu"
    fault_unit = "m/s^2, and a tenth of it in rad/s"
    bias_size = 0.5
    noise_size = 2.0

    def __init__(self, seed: int, rate_hz: float = 200.0, bias_share: float = 1.0) -> None:
        super().__init__(seed, rate_hz)
        draw, bandwidth = self._draw, sqrt(rate_hz / 2.0)
        self._force_noise = ACCELEROMETER_DENSITY_M_S2_RTHZ * bandwidth
        self._rate_noise = GYRO_DENSITY_RAD_S_RTHZ * bandwidth
        self.force_bias_m_s2 = tuple(bias_share * ACCELEROMETER_BIAS_M_S2 * draw() for _ in range(3))
        """The constant error of each accelerometer."""
        self.rate_bias_rad_s = tuple(bias_share * GYRO_BIAS_RAD_S * draw() for _ in range(3))
        """The constant error of each gyro."""

    def measure(self, motion: TrueMotion, t_s: float) -> ImuReading:
        """Add bias and white noise."""
        (fx, fy, fz), (p, q, r) = motion.imu()
        draw, force, rate = self._draw, self._force_noise, self._rate_noise
        ax, ay, az = self.force_bias_m_s2
        gx, gy, gz = self.rate_bias_rad_s
        return ImuReading(
            t_s=t_s,
            specific_force_frd_m_s2=(fx + ax + force * draw(), fy + ay + force * draw(), fz + az + force * draw()),
            rate_frd_rad_s=(p + gx + rate * draw(), q + gy + rate * draw(), r + gz + rate * draw()),
        )

    def shift(self, reading: ImuReading, offset: Vector3) -> ImuReading:
        """Add to the accelerations, and a tenth of it to the turn rates."""
        (fx, fy, fz), (p, q, r), (x, y, z) = reading.specific_force_frd_m_s2, reading.rate_frd_rad_s, offset
        return ImuReading(
            t_s=reading.t_s,
            specific_force_frd_m_s2=(fx + x, fy + y, fz + z),
            rate_frd_rad_s=(p + 0.1 * x, q + 0.1 * y, r + 0.1 * z),
        )
