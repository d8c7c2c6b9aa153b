"""The innermost loop: body rates to torques, at the rate of the gyro."""

from math import cos, sin, sqrt

from gloc3.messages.frames import Quaternion, Vector3
from gloc3_sitl.autopilot.airframe import Airframe


class RateController:
    """PID per axis; the derivative acts on the low-passed measured rate, so that a setpoint step causes no kick."""

    __slots__ = ("_acceleration", "_d", "_filter", "_i", "_integral", "_last", "_limit", "_p", "_period_s")

    def __init__(
        self, airframe: Airframe, period_s: float, derivative_cutoff_hz: float = 30.0, limit: float = 0.08
    ) -> None:
        self._p, self._i, self._d = airframe.rate_p, airframe.rate_i, airframe.rate_d
        self._period_s = period_s
        self._filter = period_s / (period_s + 1.0 / (6.2832 * derivative_cutoff_hz))
        self._limit = limit
        self._integral: Vector3 = (0.0, 0.0, 0.0)
        self._last: Vector3 = (0.0, 0.0, 0.0)
        self._acceleration: Vector3 = (0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Resets the integrators; called on the ground."""
        self._integral = (0.0, 0.0, 0.0)

    def update(self, wanted_rad_s: Vector3, rate_frd_rad_s: Vector3, is_saturated: bool) -> Vector3:
        """Roll, pitch and yaw command as fractions of full thrust of each rotor."""
        p, q, r = rate_frd_rad_s
        last_p, last_q, last_r = self._last
        self._last = rate_frd_rad_s
        filtered_p, filtered_q, filtered_r = self._acceleration
        share = self._filter
        inverse = 1.0 / self._period_s
        filtered_p += share * ((p - last_p) * inverse - filtered_p)
        filtered_q += share * ((q - last_q) * inverse - filtered_q)
        filtered_r += share * ((r - last_r) * inverse - filtered_r)
        self._acceleration = (filtered_p, filtered_q, filtered_r)
        error_p = wanted_rad_s[0] - p
        error_q = wanted_rad_s[1] - q
        error_r = wanted_rad_s[2] - r
        sum_p, sum_q, sum_r = self._integral
        if not is_saturated:
            gain_p, gain_q, gain_r = self._i
            period, limit = self._period_s, self._limit
            sum_p += gain_p * error_p * period
            sum_q += gain_q * error_q * period
            sum_r += gain_r * error_r * period
            sum_p = limit if sum_p > limit else -limit if sum_p < -limit else sum_p
            sum_q = limit if sum_q > limit else -limit if sum_q < -limit else sum_q
            sum_r = limit if sum_r > limit else -limit if sum_r < -limit else sum_r
            self._integral = (sum_p, sum_q, sum_r)
        p_p, p_q, p_r = self._p
        d_p, d_q, d_r = self._d
        return (
            p_p * error_p + sum_p - d_p * filtered_p,
            p_q * error_q + sum_q - d_q * filtered_q,
            p_r * error_r + sum_r - d_r * filtered_r,
        )


class AttitudeController:
    """Proportional in the error quaternion (Brescianini, Hehn and D'Andrea, ETH 2013), yaw weaker than tilt."""

    __slots__ = ("gain", "limit_rad_s")

    def __init__(self, gain: Vector3, limit_rad_s: Vector3 = (3.8, 3.8, 1.6)) -> None:
        self.gain = gain
        """Wanted rate per radian of error about the body's axes, in 1/s."""
        self.limit_rad_s = limit_rad_s
        """Largest rate setpoint about each body axis."""

    def update(self, ned_from_frd: Quaternion, wanted_ned_from_frd: Quaternion, yaw_rate_rad_s: float) -> Vector3:
        """Wanted body rates; `yaw_rate_rad_s` about down is fed forward."""
        w, x, y, z = ned_from_frd
        sw, sx, sy, sz = wanted_ned_from_frd
        # The error frd_from_wanted, as conj(q) * q_wanted.
        ew = w * sw + x * sx + y * sy + z * sz
        ex = w * sx - x * sw - y * sz + z * sy
        ey = w * sy + x * sz - y * sw - z * sx
        ez = w * sz - x * sy + y * sx - z * sw
        twice = 2.0 if ew >= 0.0 else -2.0
        gain = self.gain
        p = twice * gain[0] * ex
        q = twice * gain[1] * ey
        r = twice * gain[2] * ez
        if yaw_rate_rad_s:
            p += 2.0 * (x * z - w * y) * yaw_rate_rad_s
            q += 2.0 * (y * z + w * x) * yaw_rate_rad_s
            r += (1.0 - 2.0 * (x * x + y * y)) * yaw_rate_rad_s
        limit_p, limit_q, limit_r = self.limit_rad_s
        return (
            limit_p if p > limit_p else -limit_p if p < -limit_p else p,
            limit_q if q > limit_q else -limit_q if q < -limit_q else q,
            limit_r if r > limit_r else -limit_r if r < -limit_r else r,
        )


def attitude_for(force_ned_m_s2: Vector3, yaw_rad: float) -> Quaternion:
    """Attitude whose thrust points along a specific force (up in hover), at a heading.

    The force must have an upward part. The vehicle turns to the heading first and then tilts by the shortest way.
    """
    fx, fy, fz = force_ned_m_s2
    inverse = 1.0 / sqrt(fx * fx + fy * fy + fz * fz)
    zx, zy, zz = -fx * inverse, -fy * inverse, -fz * inverse
    half = 0.5 * yaw_rad
    cosine, sine = cos(half), sin(half)
    # The shortest turn from down (0, 0, 1) to body z, times the turn about down.
    tw = sqrt(0.5 * (1.0 + zz))
    scale = 0.5 / tw
    tx, ty = -zy * scale, zx * scale
    return (tw * cosine, tx * cosine + ty * sine, ty * cosine - tx * sine, tw * sine)
