"""Strapdown inertial navigation, with its recent past, open to corrections."""

from bisect import bisect_right
from math import sqrt
from typing import Final, NamedTuple

from gloc3.messages.frames import (
    GRAVITY_M_S2,
    IDENTITY,
    Quaternion,
    Vector3,
    conjugate,
    from_rotation_vector,
    multiply,
    normalize,
)

KEPT_S: Final = 1.5
"""Length of the stored history, s."""
_TRIM: Final = 400


class InertialState(NamedTuple):
    """Position, velocity and attitude at a time."""

    t_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion


class Inertial:
    """Integrates rate and specific force, and returns past states with all corrections made since.

    A correction moves the past too: by the position and, going back, by the velocity that it brings, and by its
    rotation. That is exact to first order but for gravity's share of a rotation (below 0.1 mm for 1 mrad over 0.1 s).
    So the past is kept free of all corrections, and their sums are added when it is read.
    """

    __slots__ = (
        "_moved",
        "_path",
        "_shift",
        "_slope",
        "_states",
        "_times",
        "_turn",
        "accelerometer_bias_m_s2",
        "force_ned_m_s2",
        "gyroscope_bias_rad_s",
        "now",
        "rate_frd_rad_s",
    )

    def __init__(self) -> None:
        self.gyroscope_bias_rad_s: Vector3 = (0.0, 0.0, 0.0)
        self.accelerometer_bias_m_s2: Vector3 = (0.0, 0.0, 0.0)
        self.place(InertialState(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), IDENTITY))

    def place(self, state: InertialState) -> None:
        """Starts at a state, without a past."""
        self.now = state
        self.rate_frd_rad_s: Vector3 = (0.0, 0.0, 0.0)
        self.force_ned_m_s2: Vector3 = (0.0, 0.0, -GRAVITY_M_S2)
        self._shift: Vector3 = (0.0, 0.0, 0.0)
        """Sum of the corrections of the position, each extended with its velocity back to time zero."""
        self._slope: Vector3 = (0.0, 0.0, 0.0)
        """Sum of the corrections of the velocity."""
        self._turn: Quaternion = IDENTITY
        """Product of the corrections of the attitude."""
        self._moved: Vector3 = (0.0, 0.0, 0.0)
        """Sum of the corrections of the position alone."""
        self._times: list[float] = [state.t_s]
        self._states: list[InertialState] = [state]
        self._path: list[Vector3] = [state.position_ned_m]

    def move(self, rate_frd_rad_s: Vector3, force_frd_m_s2: Vector3, t_s: float) -> None:
        """Propagates to `t_s` with the mean rate (rad/s) and specific force (m/s²) since the last state."""
        then, (px, py, pz), (vx, vy, vz), (w, x, y, z) = self.now
        dt = t_s - then
        bx, by, bz = self.gyroscope_bias_rad_s
        p, q, r = rate_frd_rad_s[0] - bx, rate_frd_rad_s[1] - by, rate_frd_rad_s[2] - bz
        self.rate_frd_rad_s = (p, q, r)
        # Half of the turn, to rotate the force by the attitude in the middle of the step.
        # Attitude: q <- q * (1, w dt/4), twice, then normalized; w is the rate less its bias.
        a, b, c = 0.25 * dt * p, 0.25 * dt * q, 0.25 * dt * r
        mw, mx, my, mz = (
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b - x * c + z * a,
            z + w * c + x * b - y * a,
        )
        w, x, y, z = (
            mw - mx * a - my * b - mz * c,
            mx + mw * a + my * c - mz * b,
            my + mw * b - mx * c + mz * a,
            mz + mw * c + mx * b - my * a,
        )
        size = 1.0 / sqrt(w * w + x * x + y * y + z * z)
        middle = 1.0 / (mw * mw + mx * mx + my * my + mz * mz)
        bx, by, bz = self.accelerometer_bias_m_s2
        fx, fy, fz = force_frd_m_s2[0] - bx, force_frd_m_s2[1] - by, force_frd_m_s2[2] - bz
        # Specific force into NED: f_n = R_mid (f_m - b_a) (strapdown equations: Groves 2013, ch. 5).
        tx = 2.0 * middle * (my * fz - mz * fy)
        ty = 2.0 * middle * (mz * fx - mx * fz)
        tz = 2.0 * middle * (mx * fy - my * fx)
        fn = fx + mw * tx + my * tz - mz * ty
        fe = fy + mw * ty + mz * tx - mx * tz
        fd = fz + mw * tz + mx * ty - my * tx
        self.force_ned_m_s2 = (fn, fe, fd)
        # Velocity and position: v <- v + (f_n + g) dt, p <- p + v dt + (f_n + g) dt^2/2.
        ad = fd + GRAVITY_M_S2
        half = 0.5 * dt
        self.now = InertialState(
            t_s,
            (px + (vx + half * fn) * dt, py + (vy + half * fe) * dt, pz + (vz + half * ad) * dt),
            (vx + fn * dt, vy + fe * dt, vz + ad * dt),
            (w * size, x * size, y * size, z * size),
        )
        self._remember()

    def _remember(self) -> None:
        t_s, (px, py, pz), (vx, vy, vz), attitude = self.now
        (sx, sy, sz), (ux, uy, uz), (mx, my, mz) = self._shift, self._slope, self._moved
        self._times.append(t_s)
        self._path.append((px - mx, py - my, pz - mz))
        self._states.append(
            InertialState(
                t_s,
                (px - sx - ux * t_s, py - sy - uy * t_s, pz - sz - uz * t_s),
                (vx - ux, vy - uy, vz - uz),
                multiply(conjugate(self._turn), attitude),
            )
        )
        if len(self._times) >= _TRIM:
            keep = bisect_right(self._times, t_s - KEPT_S)
            del self._times[:keep], self._states[:keep], self._path[:keep]

    def covers(self, t_s: float) -> bool:
        """Whether a time is within the stored past."""
        return self._times[0] - 1e-6 <= t_s <= self.now.t_s + 1e-6 and t_s >= self.now.t_s - KEPT_S

    def at(self, t_s: float) -> InertialState:
        """The state at a past time that it `covers`, as estimated now."""
        times, states = self._times, self._states
        index = bisect_right(times, t_s)
        if index >= len(times):
            return self.now
        before, after = states[max(index - 1, 0)], states[index]
        dt = after.t_s - before.t_s
        # Interpolate: position quadratic, velocity and normalized quaternion linear; then add the corrections.
        share = min(max((t_s - before.t_s) / dt, 0.0), 1.0) if dt > 0.0 else 0.0
        (sx, sy, sz), (ux, uy, uz) = self._shift, self._slope
        (ax, ay, az), (bx, by, bz) = before.position_ned_m, after.position_ned_m
        (ap, aq, ar), (bp, bq, br) = before.velocity_ned_m_s, after.velocity_ned_m_s
        mixed = _between(before.ned_from_frd, after.ned_from_frd, share)
        # The way between two states bends with the change of the velocity.
        bend = 0.5 * share * (share - 1.0) * dt
        return InertialState(
            t_s,
            (
                ax + (bx - ax) * share + bend * (bp - ap) + sx + ux * t_s,
                ay + (by - ay) * share + bend * (bq - aq) + sy + uy * t_s,
                az + (bz - az) * share + bend * (br - ar) + sz + uz * t_s,
            ),
            (ap + (bp - ap) * share + ux, aq + (bq - aq) * share + uy, ar + (br - ar) * share + uz),
            multiply(self._turn, mixed),
        )

    def path_at(self, t_s: float) -> Vector3:
        """Where the velocities led that were estimated at each moment, without the corrections of the position.

        No later correction changes it, so differences of it add up, whenever they are taken.
        """
        index = min(bisect_right(self._times, t_s), len(self._times) - 1)
        before, after = self._states[max(index - 1, 0)], self._states[index]
        dt = after.t_s - before.t_s
        share = min(max((t_s - before.t_s) / dt, 0.0), 1.0) if dt > 0.0 else 1.0
        bend = 0.5 * share * (share - 1.0) * dt
        (ax, ay, az), (bx, by, bz) = self._path[max(index - 1, 0)], self._path[index]
        (ap, aq, ar), (bp, bq, br) = before.velocity_ned_m_s, after.velocity_ned_m_s
        return (
            ax + (bx - ax) * share + bend * (bp - ap),
            ay + (by - ay) * share + bend * (bq - aq),
            az + (bz - az) * share + bend * (br - ar),
        )

    def correct(self, position_m: Vector3, velocity_m_s: Vector3, rotation_ned_rad: Vector3) -> None:
        """Adds to position and velocity, and turns the attitude by a small rotation vector in NED."""
        t_s, (px, py, pz), (vx, vy, vz), attitude = self.now
        (dx, dy, dz), (ex, ey, ez) = position_m, velocity_m_s
        turn = from_rotation_vector(rotation_ned_rad)
        self.now = InertialState(
            t_s, (px + dx, py + dy, pz + dz), (vx + ex, vy + ey, vz + ez), normalize(multiply(turn, attitude))
        )
        (sx, sy, sz), (ux, uy, uz) = self._shift, self._slope
        # Move the past along: p(t) by dp + dv (t - now), v by dv, attitude by exp(dtheta).
        self._shift = (sx + dx - ex * t_s, sy + dy - ey * t_s, sz + dz - ez * t_s)
        self._slope = (ux + ex, uy + ey, uz + ez)
        mx, my, mz = self._moved
        self._moved = (mx + dx, my + dy, mz + dz)
        self._turn = normalize(multiply(turn, self._turn))


def _between(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """On the straight line between two attitudes that are near each other."""
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    left, right = 1.0 - share, share if dot >= 0.0 else -share
    return normalize(
        (
            a[0] * left + b[0] * right,
            a[1] * left + b[1] * right,
            a[2] * left + b[2] * right,
            a[3] * left + b[3] * right,
        )
    )
