"""The inertial solution: attitude, velocity and position from gyro and accelerometer, with corrections."""

from collections import deque
from math import sqrt
from typing import Final, NamedTuple

from gloc3.messages.frames import GRAVITY_M_S2, IDENTITY, Quaternion, Vector3

_LEARNING_RATE_RAD_S: Final = 0.175
"""Rate of a steady turn above which the gyro bias is kept: a correction answers an error of the tilt late, and the bias
of the body lies elsewhere by then. Learnt all the same it grows, and within ten minutes of circling the attitude is lost."""
_SETTLING_S: Final = 120.0
"""So long after the alignment the bias is learnt in turns, too: what floats may have been aligned as it rocked."""
_STEADY_S: Final = 2.0
"""Time constant of the low-pass filter that tells a steady turn from rocking in waves."""
_HISTORY_PERIODS: Final = 5
"""Every how many steps a past state is kept."""


class PastState(NamedTuple):
    """A past state of the vehicle, for measurements that arrive late."""

    t_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3


class InertialSolution:
    """Integrates the IMU at its rate, and applies corrections in small steps.

    Past states are kept without the corrections made so far, so that a late measurement is compared with the present
    estimate of its time.
    """

    __slots__ = (
        "_count",
        "_history",
        "_position_shift",
        "_steady_rate",
        "_velocity_shift",
        "acceleration_ned_m_s2",
        "aligned_s",
        "down_bias_m_s2",
        "gyro_bias_rad_s",
        "ned_from_frd",
        "position_ned_m",
        "rate_frd_rad_s",
        "t_s",
        "velocity_ned_m_s",
    )

    def __init__(self) -> None:
        self.t_s = 0.0
        self.aligned_s = 0.0
        """When the attitude was found."""
        self.ned_from_frd: Quaternion = IDENTITY
        self.rate_frd_rad_s: Vector3 = (0.0, 0.0, 0.0)
        self.gyro_bias_rad_s: Vector3 = (0.0, 0.0, 0.0)
        self.down_bias_m_s2 = 0.0
        """What is added to the vertical acceleration."""
        self.acceleration_ned_m_s2: Vector3 = (0.0, 0.0, 0.0)
        """Low-passed (0.05 s), for damping and for touchdown."""
        self.velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
        self.position_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._position_shift: Vector3 = (0.0, 0.0, 0.0)
        self._velocity_shift: Vector3 = (0.0, 0.0, 0.0)
        self._steady_rate: Vector3 = (0.0, 0.0, 0.0)
        self._count = 0
        self._history: deque[PastState] = deque(maxlen=40)

    def predict(self, force_frd_m_s2: Vector3, rate_frd_rad_s: Vector3, t_s: float, dt_s: float) -> None:
        """Advances by one IMU sample, a specific force and a body rate valid for the last `dt_s`."""
        bp, bq, br = self.gyro_bias_rad_s
        p, q, r = rate_frd_rad_s
        p -= bp
        q -= bq
        r -= br
        self.rate_frd_rad_s = (p, q, r)
        half = 0.5 * dt_s
        hx, hy, hz = p * half, q * half, r * half
        w, x, y, z = self.ned_from_frd
        hw = 1.0 - 0.5 * (hx * hx + hy * hy + hz * hz)
        w, x, y, z = (
            w * hw - x * hx - y * hy - z * hz,
            x * hw + w * hx + y * hz - z * hy,
            y * hw + w * hy - x * hz + z * hx,
            z * hw + w * hz + x * hy - y * hx,
        )
        scale = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)
        w *= scale
        x *= scale
        y *= scale
        z *= scale
        self.ned_from_frd = (w, x, y, z)
        fx, fy, fz = force_frd_m_s2
        tx = 2.0 * (y * fz - z * fy)
        ty = 2.0 * (z * fx - x * fz)
        tz = 2.0 * (x * fy - y * fx)
        an = fx + w * tx + y * tz - z * ty
        ae = fy + w * ty + z * tx - x * tz
        ad = fz + w * tz + x * ty - y * tx + GRAVITY_M_S2 + self.down_bias_m_s2
        sn, se, sd = self.acceleration_ned_m_s2
        share = dt_s * 20.0
        self.acceleration_ned_m_s2 = (sn + share * (an - sn), se + share * (ae - se), sd + share * (ad - sd))
        vn, ve, vd = self.velocity_ned_m_s
        n, e, d = self.position_ned_m
        self.position_ned_m = (
            n + (vn + an * half) * dt_s,
            e + (ve + ae * half) * dt_s,
            d + (vd + ad * half) * dt_s,
        )
        self.velocity_ned_m_s = (vn + an * dt_s, ve + ae * dt_s, vd + ad * dt_s)
        self.t_s = t_s
        self._count += 1
        if self._count >= _HISTORY_PERIODS:
            self._count = 0
            self._remember()

    def _remember(self) -> None:
        if self._history:
            share = min(1.0, (self.t_s - self._history[-1].t_s) / _STEADY_S)
            (p, q, r), (sp, sq, sr) = self.rate_frd_rad_s, self._steady_rate
            self._steady_rate = (sp + share * (p - sp), sq + share * (q - sq), sr + share * (r - sr))
        n, e, d = self.position_ned_m
        vn, ve, vd = self.velocity_ned_m_s
        pn, pe, pd = self._position_shift
        un, ue, ud = self._velocity_shift
        self._history.append(PastState(self.t_s, (n - pn, e - pe, d - pd), (vn - un, ve - ue, vd - ud)))

    def at(self, t_s: float) -> PastState:
        """What is believed now about an earlier time (at most 0.8 s back), interpolated along the velocity."""
        history = self._history
        age = self.t_s - t_s
        if age < 0.005 or not history:
            return PastState(self.t_s, self.position_ned_m, self.velocity_ned_m_s)
        newest = history[-1].t_s
        if len(history) > 1:
            period = history[-1].t_s - history[-2].t_s
            back = round((newest - t_s) / period) if period > 0.0 else 0
        else:
            back = 0
        past = history[-1 - min(max(back, 0), len(history) - 1)]
        dt = max(-0.05, min(0.05, t_s - past.t_s))
        n, e, d = past.position_ned_m
        vn, ve, vd = past.velocity_ned_m_s
        pn, pe, pd = self._position_shift
        un, ue, ud = self._velocity_shift
        vn, ve, vd = vn + un, ve + ue, vd + ud
        return PastState(t_s, (n + pn + vn * dt, e + pe + ve * dt, d + pd + vd * dt), (vn, ve, vd))

    def correct_motion(self, position_m: Vector3, velocity_m_s: Vector3) -> None:
        """Adds small steps to position and velocity."""
        n, e, d = self.position_ned_m
        self.position_ned_m = (n + position_m[0], e + position_m[1], d + position_m[2])
        n, e, d = self._position_shift
        self._position_shift = (n + position_m[0], e + position_m[1], d + position_m[2])
        n, e, d = self.velocity_ned_m_s
        self.velocity_ned_m_s = (n + velocity_m_s[0], e + velocity_m_s[1], d + velocity_m_s[2])
        n, e, d = self._velocity_shift
        self._velocity_shift = (n + velocity_m_s[0], e + velocity_m_s[1], d + velocity_m_s[2])

    def place(self, position_ned_m: Vector3, velocity_ned_m_s: Vector3) -> None:
        """Moves the position estimate, including its history."""
        n, e, d = self.position_ned_m
        vn, ve, vd = self.velocity_ned_m_s
        pn, pe, pd = position_ned_m
        un, ue, ud = velocity_ned_m_s
        self.correct_motion((pn - n, pe - e, pd - d), (un - vn, ue - ve, ud - vd))

    def turn(self, rotation_ned_rad: Vector3, bias_share: float = 0.0) -> None:
        """Turns the attitude by a small rotation vector in NED; `bias_share` per turn goes to the gyro bias, in 1/s.

        In a steady turn the bias stays as it is, once the first minutes have found it.
        """
        tx, ty, tz = rotation_ned_rad
        hx, hy, hz = 0.5 * tx, 0.5 * ty, 0.5 * tz
        w, x, y, z = self.ned_from_frd
        w, x, y, z = (
            w - hx * x - hy * y - hz * z,
            x + hx * w + hy * z - hz * y,
            y + hy * w - hx * z + hz * x,
            z + hz * w + hx * y - hy * x,
        )
        scale = 1.0 / sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w * scale, x * scale, y * scale, z * scale
        self.ned_from_frd = (w, x, y, z)
        p, q, r = self._steady_rate
        is_settling = self.t_s - self.aligned_s < _SETTLING_S
        if bias_share and (is_settling or p * p + q * q + r * r < _LEARNING_RATE_RAD_S**2):
            # The same turn seen in the body, by the conjugate.
            ux = 2.0 * (z * ty - y * tz)
            uy = 2.0 * (x * tz - z * tx)
            uz = 2.0 * (y * tx - x * ty)
            bx, by, bz = self.gyro_bias_rad_s
            self.gyro_bias_rad_s = (
                bx - bias_share * (tx + w * ux - y * uz + z * uy),
                by - bias_share * (ty + w * uy - z * ux + x * uz),
                bz - bias_share * (tz + w * uz - x * uy + y * ux),
            )
