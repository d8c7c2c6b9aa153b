"""The innermost loop: body rates to torques, at the rate of the gyro."""

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.airframe import Airframe


class RateController:
    """PID per axis; the derivative acts on the measured rate and is low-passed, so that a step in the wish does not kick."""

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
        """Forgets the integrals; called while on the ground."""
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
