"""Attitude to body rates, and a wanted acceleration to an attitude."""

from math import cos, sin, sqrt

from gloc3.messages.frames import Quaternion, Vector3


class AttitudeController:
    """Proportional in the error quaternion (Brescianini, Hehn and D'Andrea, ETH 2013), yaw weaker than tilt."""

    __slots__ = ("gain", "limit_rad_s")

    def __init__(self, gain: Vector3, limit_rad_s: Vector3 = (3.8, 3.8, 1.6)) -> None:
        self.gain = gain
        """Wanted rate per radian of error about the body's axes, in 1/s."""
        self.limit_rad_s = limit_rad_s
        """Largest rate asked for about each of the body's axes."""

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
    """The attitude whose thrust points along a specific force (up in hover) with a heading.

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
