"""Motion by the inertial unit alone over the last seconds: a witness that shares no error with any other source.

The estimate follows the inertial unit between its corrections. So the inertial unit's own motion since a time is the
estimated one less what the corrections since then have brought: their velocities and, through their rotations and
biases, their accelerations. Its covariance follows from that of the state at that time, and grows with the cube of the
time: over a second it is some millimetres.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.error_state import ACCELEROMETER, ROTATION, VELOCITY, Matrix, skew

KEPT_S: Final = 6.5


class _Moment(NamedTuple):
    covariance: Matrix
    """(9, 9): of velocity, rotation and bias of the accelerometers."""
    ned_from_frd: Matrix
    force_ned_m_s2: Vector3


class InertialMotion:
    """Corrections and covariances of the last seconds.

    Args:
        force_noise: density of the noise of the specific force, m/s²/√Hz.
    """

    def __init__(self, force_noise: float) -> None:
        self._force_noise = force_noise
        self._corrections: deque[tuple[float, ...]] = deque()
        """Time, change of the position, of the velocity and of the acceleration, of each correction."""
        self._times: list[float] = []
        self._moments: deque[_Moment] = deque()

    def clear(self) -> None:
        """Forgets the states before, which are not known well enough; not the corrections."""
        self._times.clear()
        self._moments.clear()

    def correct(self, t_s: float, position_m: Vector3, velocity_m_s: Vector3, acceleration_m_s2: Vector3) -> None:
        """Notes a correction of position and velocity, and of the acceleration that follows from attitude and bias."""
        self._corrections.append((t_s, *position_m, *velocity_m_s, *acceleration_m_s2))
        while self._corrections[0][0] < t_s - KEPT_S:
            self._corrections.popleft()

    def corrected(self, begin_s: float) -> tuple[Matrix, Matrix]:
        """By how much all corrections since a time have changed position and velocity, (3,) each."""
        n = e = d = u = v = w = 0.0
        for t_s, dn, de, dd, du, dv, dw, *_ in reversed(self._corrections):
            if t_s <= begin_s:
                break
            n, e, d, u, v, w = n + dn, e + de, d + dd, u + du, v + dv, w + dw
        return np.array((n, e, d)), np.array((u, v, w))

    def remember(self, t_s: float, covariance: Matrix, ned_from_frd: Matrix, force_ned_m_s2: Vector3) -> None:
        """Notes the covariance (n, n) of the error state at a time, from which on motion may be asked for."""
        self._times.append(t_s)
        self._moments.append(_Moment(covariance[_KEPT].copy(), ned_from_frd, force_ned_m_s2))
        while self._times[0] < t_s - KEPT_S:
            del self._times[0]
            self._moments.popleft()

    @property
    def times(self) -> Sequence[float]:
        """The remembered times."""
        return self._times

    def excess(self, begin_s: float, end_s: float) -> tuple[Matrix, Matrix] | None:
        """Motion by the inertial unit alone less the estimated one, (3,) in NED, with its covariance (3, 3).

        Args:
            begin_s: start; the last remembered time before it counts.
            end_s: end.

        Returns:
            None where nothing is remembered of the start.
        """
        index = bisect_right(self._times, begin_s + 1e-6) - 1
        if index < 0:
            return None
        begin_s = self._times[index]
        duration_s = end_s - begin_s
        rows = [row for row in self._corrections if begin_s < row[0] < end_s]
        by_m = np.zeros(3)
        if rows:
            # Without the corrections: -sum(dv_k a_k + da_k a_k^2 / 2), a_k their ages at the end.
            table = np.array(rows)
            ages = end_s - table[:, :1]
            by_m = -np.sum(table[:, 4:7] * ages + 0.5 * table[:, 7:10] * ages * ages, axis=0)
        moment = self._moments[index]
        # J P J^T + q T^3 / 3 with J = [T, -T^2/2 [f]x, -T^2/2 R] on velocity, rotation and bias (Solà 2017, ch. 7).
        half = 0.5 * duration_s * duration_s
        jacobian = np.hstack((np.eye(3) * duration_s, -half * skew(moment.force_ned_m_s2), -half * moment.ned_from_frd))
        noise = self._force_noise**2 * duration_s**3 / 3.0
        return by_m, jacobian @ moment.covariance @ jacobian.T + noise * np.eye(3)


_ROWS: Final = np.r_[VELOCITY, ROTATION, ACCELEROMETER]
_KEPT: Final = np.ix_(_ROWS, _ROWS)
