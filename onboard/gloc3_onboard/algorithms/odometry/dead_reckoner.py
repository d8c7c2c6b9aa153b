"""Dead reckoning from velocity over ground and heading since the last satellite fix."""

from math import cos, exp, pi, sin, sqrt
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_UNKNOWN_M_S: Final = 2.0
"""Deviation of a velocity of which nothing is known."""
_N, _E, _VN, _VE, _TURN, _SCALE = range(6)


class Errors(msgspec.Struct, frozen=True, kw_only=True):
    """Error model before a dive: standard deviations."""

    heading_rad: float = 0.0175
    """Of heading and mounting angle together, constant for long."""
    deviation_rad: float = 0.004
    """Of the heading-dependent part, such as a compass's deviation: a full turn cancels it."""
    scale: float = 0.003
    """Of the DVL's scale: salinity and temperature make most of it. Of the radius of wheels."""
    scale_walk: float = 0.0
    """Random walk of the scale error, per square root of a second: wheels slip more on some ground."""
    heading_walk_rad: float = 0.0003
    """Growth of the heading's error in one second's root."""
    acceleration_m_s2: float = 0.12
    """Random walk of the velocity, per square root of a second."""
    adrift_m_s: float = 0.3
    """Of an unmeasured velocity: the current, and the vehicle's error in following commands."""
    memory_s: float = 5.0
    """Time constant with which the last measured velocity changes to the commanded one, where none is measured."""


class DeadReckoner:
    """A Kalman filter of the errors of dead reckoning in the horizontal plane.

    State: position (north, east), velocity over ground (north, east), error of the heading with the mounting angle of
    the DVL, and error of its scale, or of that of wheels. A measured velocity is `(1 + scale) * turned(error) * true`,
    so the two errors are estimated while satellites give the position, and their part in the position's covariance
    grows with the distance after that. Where no velocity is measured, the vehicle is assumed to follow its commands,
    and the covariance includes the possible error of that (a constant that cannot be observed).

    Args:
        errors: prior standard deviations.
    """

    def __init__(self, errors: Errors = Errors()) -> None:  # noqa: B008 # frozen
        self.errors: Final = errors
        self.x: Array = np.zeros(6)
        """The state: m, m, m/s, m/s, rad, share."""
        self.covariance: Array = np.diag(
            [1e8, 1e8, errors.adrift_m_s**2, errors.adrift_m_s**2, errors.heading_rad**2, errors.scale**2]
        )
        """Of the state."""

    def begin(self, north_m: float, east_m: float, std_m: float) -> None:
        """Sets the position, with this standard deviation along each axis; keeps the other errors."""
        self.x[_N], self.x[_E] = north_m, east_m
        # A new position is independent of all other errors: its rows and columns of P are cleared.
        self.covariance[:2, :] = 0.0
        self.covariance[:, :2] = 0.0
        self.covariance[_N, _N] = self.covariance[_E, _E] = std_m**2

    def inflate_velocity(self) -> None:
        """Resets the velocity's covariance after a wrong measurement of it."""
        self.covariance[_VN : _VE + 1, :] = 0.0
        self.covariance[:, _VN : _VE + 1] = 0.0
        self.covariance[_VN, _VN] = self.covariance[_VE, _VE] = _UNKNOWN_M_S**2

    def predict(self, dt_s: float, *, is_measured: bool, commanded_m_s: tuple[float, float] = (0.0, 0.0)) -> None:
        """Propagates state and covariance over a time step.

        Args:
            dt_s: the time.
            is_measured: whether velocities are measured meanwhile.
            commanded_m_s: the commanded velocity, north and east; used where none is measured.
        """
        errors = self.errors
        step = np.eye(6)
        # Transition F: p <- p + v dt; noise makes random walks of velocity, heading error and scale error.
        step[_N, _VN] = step[_E, _VE] = dt_s
        noise = np.zeros(6)
        if is_measured:
            noise[_VN] = noise[_VE] = errors.acceleration_m_s2**2 * dt_s
        else:
            # The belief follows what is asked; its error, the current above all, stays what it is.
            # Unmeasured, a first-order lag: v <- v + (1 - exp(-dt / memory)) (commanded - v).
            change = 1.0 - exp(-dt_s / errors.memory_s)
            self.x[_VN] += change * (commanded_m_s[0] - self.x[_VN])
            self.x[_VE] += change * (commanded_m_s[1] - self.x[_VE])
            for axis in (_VN, _VE):
                noise[axis] = change * max(0.0, errors.adrift_m_s**2 - self.covariance[axis, axis])
        noise[_TURN] = errors.heading_walk_rad**2 * dt_s
        noise[_SCALE] = errors.scale_walk**2 * dt_s
        # Predict: x <- F x, P <- F P F^T + Q (Bar-Shalom, Li, Kirubarajan 2001, 5.2).
        self.x = step @ self.x
        self.covariance = step @ self.covariance @ step.T + np.diag(noise)

    def turned(self, angle_rad: float) -> None:
        """Adds heading variance after a turn, as a compass's deviation depends on the heading."""
        # Deviations of two headings: as good as independent half a turn apart, 2 sigma^2; in proportion below.
        self.covariance[_TURN, _TURN] += 2.0 * self.errors.deviation_rad**2 * min(1.0, abs(angle_rad) / pi)

    def use_velocity(
        self, forward_m_s: float, right_m_s: float, yaw_rad: float, std_m_s: float, side_std_m_s: float | None = None
    ) -> float:
        """Updates with a velocity in the body's level plane, from the DVL or from wheels.

        Args:
            forward_m_s: ahead.
            right_m_s: to the right.
            yaw_rad: the heading.
            std_m_s: standard deviation forward, and also sideways where that is not given.
            side_std_m_s: standard deviation to the right.

        Returns:
            The squared innovation over its gate (5 deviations); above 1 it was rejected.
        """
        # Measurement: z = (1 + s) R(psi + e)^T v, of scale error s and heading error e.
        vn, ve, turn, scale = self.x[_VN], self.x[_VE], self.x[_TURN], self.x[_SCALE]
        heading = yaw_rad + turn
        cosine, sine = cos(heading), sin(heading)
        along, across = cosine * vn + sine * ve, cosine * ve - sine * vn
        expected = (1.0 + scale) * np.array([along, across])
        h = np.zeros((2, 6))
        # Jacobian H of z by velocity, heading error and scale error.
        h[0, _VN], h[0, _VE] = (1.0 + scale) * cosine, (1.0 + scale) * sine
        h[1, _VN], h[1, _VE] = -(1.0 + scale) * sine, (1.0 + scale) * cosine
        h[0, _TURN], h[1, _TURN] = (1.0 + scale) * across, -(1.0 + scale) * along
        h[0, _SCALE], h[1, _SCALE] = along, across
        side = std_m_s if side_std_m_s is None else side_std_m_s
        return self._update(np.array([forward_m_s, right_m_s]) - expected, h, (std_m_s**2, side**2))

    def use_fix(self, north_m: float, east_m: float, std_m: float) -> float:
        """Updates with a satellite position; returns as `use_velocity` does."""
        # Measurement: residual z - p, H = I on the position.
        h = np.zeros((2, 6))
        h[0, _N] = h[1, _E] = 1.0
        return self._update(np.array([north_m, east_m]) - self.x[:2], h, (std_m**2, std_m**2))

    def _update(self, innovation: Array, h: Array, variances: tuple[float, float]) -> float:
        # Gate: y^T S^-1 y against 5^2, S = H P H^T + R.
        spread = h @ self.covariance @ h.T + np.diag(variances)
        ratio = float(innovation @ np.linalg.solve(spread, innovation)) / 25.0
        if ratio > 1.0:
            return ratio
        # Update: K = P H^T S^-1, x <- x + K y, P <- (I - K H) P (I - K H)^T + K R K^T (Joseph form).
        gain = self.covariance @ h.T @ np.linalg.inv(spread)
        rest = np.eye(6) - gain @ h
        self.x = self.x + gain @ innovation
        self.covariance = rest @ self.covariance @ rest.T + (np.array(variances) * gain) @ gain.T
        return ratio

    @property
    def position_m(self) -> tuple[float, float]:
        """Position north and east."""
        return float(self.x[_N]), float(self.x[_E])

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        """Velocity over ground, north and east."""
        return float(self.x[_VN]), float(self.x[_VE])

    @property
    def heading_error_rad(self) -> float:
        """The correction to add to the heading."""
        return float(self.x[_TURN])

    @property
    def std_m(self) -> tuple[float, float]:
        """Standard deviation of the position along north and east."""
        return sqrt(max(0.0, float(self.covariance[_N, _N]))), sqrt(max(0.0, float(self.covariance[_E, _E])))
