"""The uncertainty of one axis: position, velocity and acceleration error, with the gains of each measurement."""

Gains = tuple[float, float, float]
"""What a unit of innovation changes in position, velocity and acceleration."""


class AxisFilter:
    """Covariance of a three-state Kalman filter whose inputs are integrated accelerations.

    Only the covariance is kept here, the state is the inertial solution's: north and east have the same measurements
    and share one filter. States: position [m], velocity [m/s], error of the acceleration [m/s^2] (in the
    horizontal axes nearly all of it is tilt).
    """

    __slots__ = ("_aa", "_pa", "_pp", "_pv", "_va", "_vv", "acceleration_walk", "velocity_walk")

    def __init__(self, velocity_walk: float, acceleration_walk: float) -> None:
        self.velocity_walk = velocity_walk
        """Growth of the velocity's variance, in (m/s)^2 per second."""
        self.acceleration_walk = acceleration_walk
        """Growth of the acceleration error's variance, in (m/s^2)^2 per second."""
        self._pp = self._pv = self._pa = self._vv = self._va = self._aa = 0.0
        self.reset(100.0, 1.0, 0.09)

    def reset(self, position_m2: float, velocity_m2_s2: float, acceleration_m2_s4: float | None = None) -> None:
        """Resets the variances; the acceleration error is kept unless one is given."""
        self._pp, self._vv = position_m2, velocity_m2_s2
        self._pv = self._pa = self._va = 0.0
        if acceleration_m2_s4 is not None:
            self._aa = acceleration_m2_s4

    @property
    def position_variance_m2(self) -> float:
        """Variance of the position."""
        return self._pp

    @property
    def velocity_variance_m2_s2(self) -> float:
        """Variance of the velocity."""
        return self._vv

    def predict(self, dt_s: float) -> None:
        """Lets the uncertainty grow over a time."""
        pv, pa, vv, va, aa = self._pv, self._pa, self._vv, self._va, self._aa
        square = dt_s * dt_s
        walk = self.velocity_walk * dt_s
        self._pp += dt_s * (2.0 * pv) + square * (vv + pa + dt_s * va + 0.25 * square * aa) + walk * square / 3.0
        self._pv = pv + dt_s * (vv + pa) + square * (1.5 * va + 0.5 * dt_s * aa) + walk * dt_s * 0.5
        self._pa = pa + dt_s * va + 0.5 * square * aa
        self._vv = vv + 2.0 * dt_s * va + square * aa + walk
        self._va = va + dt_s * aa
        self._aa = aa + self.acceleration_walk * dt_s

    def measure_position(self, variance_m2: float) -> Gains:
        """Updates with a position of this variance; returns the gains for its innovation."""
        pp, pv, pa = self._pp, self._pv, self._pa
        inverse = 1.0 / (pp + variance_m2)
        kp, kv, ka = pp * inverse, pv * inverse, pa * inverse
        self._vv -= kv * pv
        self._va -= kv * pa
        self._aa -= ka * pa
        self._pp = pp - kp * pp
        self._pv = pv - kp * pv
        self._pa = pa - kp * pa
        return kp, kv, ka

    def measure_velocity(self, variance_m2_s2: float) -> Gains:
        """Updates with a velocity of this variance; returns the gains for its innovation."""
        pv, vv, va = self._pv, self._vv, self._va
        inverse = 1.0 / (vv + variance_m2_s2)
        kp, kv, ka = pv * inverse, vv * inverse, va * inverse
        self._pp -= kp * pv
        self._pa -= kp * va
        self._aa -= ka * va
        self._pv = pv - kp * vv
        self._vv = vv - kv * vv
        self._va = va - kv * va
        return kp, kv, ka
