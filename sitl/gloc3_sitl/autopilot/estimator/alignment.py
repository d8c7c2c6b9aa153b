"""Initial alignment of the attitude, at rest or while the vehicle rocks about its mean."""

from math import asin, atan2, sqrt

from gloc3.messages.frames import Quaternion, Vector3, from_euler, rotate

_SAMPLES = 160
"""IMU samples that are averaged: 0.8 s at 200 Hz."""
_STILL_RAD_S = 0.1
"""Largest body rate that still counts as standing."""
_STILL_AFLOAT_RAD_S = 0.02
"""The same for what floats: slow rocking would be taken for a bias of the gyros."""
_MOST_WAITS = 2000
"""Samples without rest (10 s) after which the vehicle counts as floating; waves are averaged then."""
_ROCKING_RAD_S = 1.5
_ROCKING_SAMPLES = 1600


class InertialAlignment:
    """Averages the IMU at rest; yields attitude and gyro bias."""

    __slots__ = ("_count", "_force", "_is_afloat", "_rate", "_seen", "field_frd")

    def __init__(self) -> None:
        self._count = self._seen = 0
        self._is_afloat = False
        self._force: Vector3 = (0.0, 0.0, 0.0)
        self._rate: Vector3 = (0.0, 0.0, 0.0)
        self.field_frd: Vector3 | None = None
        """The newest magnetic field in the body, in any unit."""

    def add(self, force_frd_m_s2: Vector3, rate_frd_rad_s: Vector3, *, floats: bool = False) -> bool:
        """Adds one IMU sample of a standing or floating vehicle; returns whether the average is complete."""
        p, q, r = rate_frd_rad_s
        self._seen += 1
        is_afloat = self._is_afloat = self._seen > _MOST_WAITS
        most = _ROCKING_RAD_S if is_afloat else _STILL_AFLOAT_RAD_S if floats else _STILL_RAD_S
        if p * p + q * q + r * r > most * most:
            self._count = 0
            self._force = self._rate = (0.0, 0.0, 0.0)
            return False
        fx, fy, fz = force_frd_m_s2
        ax, ay, az = self._force
        self._force = (ax + fx, ay + fy, az + fz)
        ap, aq, ar = self._rate
        self._rate = (ap + p, aq + q, ar + r)
        self._count += 1
        return self._count >= (_ROCKING_SAMPLES if is_afloat else _SAMPLES)

    @property
    def gyro_bias_rad_s(self) -> Vector3:
        """Mean body rate of the time at rest; none afloat, where it is rather by how much the last wave has turned the vehicle."""
        if self._is_afloat:
            return (0.0, 0.0, 0.0)
        p, q, r = self._rate
        return (p / self._count, q / self._count, r / self._count)

    def attitude(self, declination_rad: float) -> Quaternion:
        """Level by gravity, heading by the magnetic field (north where there is none)."""
        fx, fy, fz = self._force
        size = sqrt(fx * fx + fy * fy + fz * fz)
        pitch = asin(max(-1.0, min(1.0, fx / size)))
        roll = atan2(-fy, -fz)
        if self.field_frd is None:
            return from_euler(roll, pitch, 0.0)
        north, east, _ = rotate(from_euler(roll, pitch, 0.0), self.field_frd)
        return from_euler(roll, pitch, declination_rad - atan2(east, north))
