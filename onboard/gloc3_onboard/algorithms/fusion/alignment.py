"""Initial alignment at rest: roll and pitch from gravity, heading as declared.

Source: Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd edition, 2013, 5.6.
"""

from math import asin, atan2, sqrt
from typing import Final, NamedTuple

from gloc3.messages.frames import GRAVITY_M_S2, Vector3, from_euler
from gloc3_onboard.algorithms.fusion.inertial import InertialState

STILL_S: Final = 0.5
_STILL_RAD_S: Final = 0.1
_STILL_M_S2: Final = 1.0
_STARTED_RAD_S: Final = 0.03
_STARTED_M_S2: Final = 0.12
_SHARE: Final = 0.1


class StartPose(NamedTuple):
    """Initial pose before any measurement, as declared or as the autopilot reports it."""

    state: InertialState
    position_std_m: float
    heading_std_rad: float
    is_moving: bool
    """In flight the attitude and velocity of `state` are taken; at rest only position and heading."""


class RestMonitor:
    """Detects the first motion after alignment; once the body has moved, it no longer counts as standing."""

    def __init__(self) -> None:
        self.is_standing = False
        self._force_m_s2 = GRAVITY_M_S2
        self._mean_m_s2 = GRAVITY_M_S2
        self._rate: Vector3 = (0.0, 0.0, 0.0)

    def begin(self, force: Vector3) -> None:
        """Starts at rest with this specific force."""
        self.is_standing = True
        self._force_m_s2 = self._mean_m_s2 = sqrt(sum(value * value for value in force))
        self._rate = (0.0, 0.0, 0.0)

    def add(self, rate_frd_rad_s: Vector3, force: Vector3) -> None:
        """Adds a sample, its rate already corrected for bias."""
        if not self.is_standing:
            return
        size = sqrt(sum(value * value for value in force))
        self._mean_m_s2 += _SHARE * (size - self._mean_m_s2)
        p, q, r = (mean + _SHARE * (now - mean) for mean, now in zip(self._rate, rate_frd_rad_s, strict=True))
        self._rate = (p, q, r)
        has_turned = p * p + q * q + r * r > _STARTED_RAD_S**2
        if has_turned or abs(self._mean_m_s2 - self._force_m_s2) > _STARTED_M_S2:
            self.is_standing = False


class RestAlignment:
    """Averages IMU samples while the body is at rest."""

    def __init__(self) -> None:
        self._restart(0.0)

    def _restart(self, t_s: float) -> None:
        self._begin_s = t_s
        self._count = 0
        self._force = self._rate = (0.0, 0.0, 0.0)

    def add(self, rate: Vector3, force: Vector3, t_s: float) -> bool:
        """Adds a sample; true once there are enough at rest."""
        size = sqrt(sum(value * value for value in force))
        # Gate: at rest while |w| and ||f| - g| are within their limits; else averaging restarts.
        if sum(value * value for value in rate) > _STILL_RAD_S**2 or abs(size - GRAVITY_M_S2) > _STILL_M_S2:
            self._restart(t_s)
            return False
        if not self._count:
            self._begin_s = t_s
        self._count += 1
        fx, fy, fz = self._force
        self._force = (fx + force[0], fy + force[1], fz + force[2])
        p, q, r = self._rate
        self._rate = (p + rate[0], q + rate[1], r + rate[2])
        return t_s - self._begin_s >= STILL_S and self._count >= 10

    @property
    def force(self) -> Vector3:
        """The mean specific force."""
        x, y, z = self._force
        return (x / self._count, y / self._count, z / self._count)

    def state(self, start: InertialState, t_s: float) -> tuple[InertialState, Vector3]:
        """The aligned state, with the position and heading of `start`, and the gyroscope bias."""
        fx, fy, fz = self._force
        # Leveling: at rest f = R^T (0, 0, -g): sin(pitch) = f_x / |f|, roll = atan2(-f_y, -f_z) (Groves 2013, 5.6).
        pitch = asin(max(-1.0, min(1.0, fx / sqrt(fx * fx + fy * fy + fz * fz))))
        roll = atan2(-fy, -fz)
        w, x, y, z = start.ned_from_frd
        heading = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        p, q, r = self._rate
        # Gyroscope bias: the mean rate at rest; the Earth's rotation, 7.3e-5 rad/s, stays in it.
        bias = (p / self._count, q / self._count, r / self._count)
        return InertialState(t_s, start.position_ned_m, (0.0, 0.0, 0.0), from_euler(roll, pitch, heading)), bias
