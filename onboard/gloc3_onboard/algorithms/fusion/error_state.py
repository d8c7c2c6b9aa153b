"""The covariance of the fusion's error state, predicted and updated by filterpy, with clones of past poses.

The error of the nominal state is (position 3, velocity 3, rotation vector 3, gyroscope bias 3, accelerometer bias 3,
level of the floor 1), all but the biases in NED: true rotation = exp(error) @ estimated rotation. It is followed by the
clones, six errors each (position, rotation) of a past pose (Roumeliotis and Burdick, *Stochastic Cloning*, ICRA 2002).
The mean of the error is always zero: an update returns the correction for the nominal state.
Sources: Solà, *Quaternion kinematics for the error-state Kalman filter*, 2017; Bar-Shalom, Li and Kirubarajan,
*Estimation with Applications to Tracking and Navigation*, 2001.
"""

from collections.abc import Callable
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.loading import load_modules
from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.kalman import load_filter

Matrix = NDArray[np.float64]

POSITION: Final = slice(0, 3)
VELOCITY: Final = slice(3, 6)
ROTATION: Final = slice(6, 9)
GYROSCOPE: Final = slice(9, 12)
ACCELEROMETER: Final = slice(12, 15)
FLOOR: Final = 15
SIZE: Final = 16
CLONE: Final = 6


def skew(vector: Vector3) -> Matrix:
    """The matrix of the cross product: `skew(a) @ b == a x b`."""
    x, y, z = vector
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def past_pose(age_s: float, ned_from_frd: Matrix, velocity_change_m_s: Vector3, distance_m: Vector3) -> Matrix:
    """Jacobian of the error of a pose `age_s` ago by the error now, shape (6, 16).

    Args:
        age_s: how long ago.
        ned_from_frd: the attitude in the meantime, (3, 3).
        velocity_change_m_s: integral of the specific force since then, in NED.
        distance_m: integral of that integral.
    """
    jacobian = np.zeros((CLONE, SIZE))
    jacobian[0, 0] = jacobian[1, 1] = jacobian[2, 2] = 1.0
    jacobian[3, 6] = jacobian[4, 7] = jacobian[5, 8] = 1.0
    # dp(t - a) = dp - a dv + [d - a u]x dtheta - a^2/2 R db_a, dtheta(t - a) = dtheta + a R db_g.
    if age_s > 1e-6:
        jacobian[0, 3] = jacobian[1, 4] = jacobian[2, 5] = -age_s
        (x, y, z), (u, v, w) = distance_m, velocity_change_m_s
        jacobian[0:3, ROTATION] = skew((x - age_s * u, y - age_s * v, z - age_s * w))
        jacobian[0:3, ACCELEROMETER] = (-0.5 * age_s * age_s) * ned_from_frd
        jacobian[3:6, GYROSCOPE] = age_s * ned_from_frd
    return jacobian


class ErrorState:
    """A covariance matrix with names for its parts."""

    def __init__(self) -> None:
        load_modules("scipy.linalg.lapack")
        from scipy.linalg.lapack import dposv

        self._solve: Callable[..., Any] = dposv
        self._predict, self._update = load_filter()
        self.covariance: Matrix = np.eye(SIZE)
        self.clones: list[str] = []
        """Whose pose each clone is, in the order of the matrix."""

    @property
    def size(self) -> int:
        """Rows of the covariance."""
        return SIZE + CLONE * len(self.clones)

    def reset(self, deviations: Matrix) -> None:
        """Starts with independent errors of these standard deviations, shape (16,), and no clones."""
        self.covariance = np.diag(deviations**2)
        self.clones = []

    def inflate(self, part: slice, std: float) -> None:
        """Adds an independent error to each row of a part."""
        rows = range(self.size)[part]
        self.covariance[rows, rows] += std * std

    def predict(
        self,
        duration_s: float,
        ned_from_frd: Matrix,
        force_ned_m_s2: Vector3,
        noise: tuple[float, float, float, float],
        floor_m2: float,
    ) -> None:
        """Propagates the covariance over a time step.

        Args:
            duration_s: the time step.
            ned_from_frd: mean attitude, (3, 3).
            force_ned_m_s2: mean specific force.
            noise: densities of gyroscope and accelerometer, and the walks of their biases.
            floor_m2: increase of the variance of the floor's level.
        """
        dt = duration_s
        # Jacobian F of dv' = -[R f]x dtheta - R db_a, dtheta' = -R db_g (global angular error: Solà 2017, ch. 7).
        lever, turned = -dt * skew(force_ned_m_s2), -dt * ned_from_frd
        transition = _UNCHANGED.copy()
        transition[0, 3] = transition[1, 4] = transition[2, 5] = dt
        transition[POSITION, ROTATION] = 0.5 * dt * lever
        transition[VELOCITY, ROTATION] = lever
        transition[POSITION, ACCELEROMETER] = 0.5 * dt * turned
        transition[VELOCITY, ACCELEROMETER] = transition[ROTATION, GYROSCOPE] = turned
        # Noise Q over dt: white rate and force noise, integrated; random walks of the biases and the floor.
        gyroscope, accelerometer, gyroscope_walk, accelerometer_walk = noise
        q = accelerometer * accelerometer * dt
        growth = np.zeros((SIZE, SIZE))
        diagonal = growth.reshape(-1)[:: SIZE + 1]
        diagonal[POSITION], diagonal[VELOCITY] = q * dt * dt / 3.0, q
        diagonal[ROTATION] = gyroscope * gyroscope * dt
        diagonal[GYROSCOPE], diagonal[ACCELEROMETER] = gyroscope_walk**2 * dt, accelerometer_walk**2 * dt
        diagonal[FLOOR] = floor_m2
        growth[0, 3] = growth[1, 4] = growth[2, 5] = growth[3, 0] = growth[4, 1] = growth[5, 2] = 0.5 * q * dt
        # Predict: P <- F P F^T + Q (Solà 2017, 5.4), after making P symmetric.
        whole = self.covariance = 0.5 * (self.covariance + self.covariance.T)
        own = whole[:SIZE, :SIZE]
        _, whole[:SIZE, :SIZE] = self._predict(_NO_ERROR, own, transition, growth)
        if self.clones:
            # Clones stand still; only their correlation changes: P_xc <- F P_xc.
            cross = transition @ whole[:SIZE, SIZE:]
            whole[:SIZE, SIZE:] = cross
            whole[SIZE:, :SIZE] = cross.T

    def clone(self, name: str, jacobian: Matrix, noise: Matrix) -> None:
        """Stores a pose as a clone, replacing any of the same name.

        Args:
            name: owner of the clone.
            jacobian: of the pose's error with respect to the present error, (6, 16).
            noise: covariance of the added noise, (6, 6).
        """
        self.drop(name)
        # Augment: P <- [[P, P J^T], [J P, J P J^T + N]] (stochastic cloning, Roumeliotis and Burdick 2002).
        previous, n = self.covariance, self.size
        whole = np.empty((n + CLONE, n + CLONE))
        whole[:n, :n] = previous
        rows = jacobian @ previous[:SIZE, :]
        whole[n:, :n] = rows
        whole[:n, n:] = rows.T
        whole[n:, n:] = rows[:, :SIZE] @ jacobian.T + noise
        self.covariance = whole
        self.clones.append(name)

    def drop(self, name: str) -> None:
        """Removes a clone, if there is one."""
        if name in self.clones:
            first = self.place_of(name)
            keep = np.r_[0:first, first + CLONE : self.size]
            self.covariance = self.covariance[np.ix_(keep, keep)]
            self.clones.remove(name)

    def place_of(self, name: str) -> int:
        """The first row of a clone."""
        return SIZE + CLONE * self.clones.index(name)

    def loosen(self, first: int, variances: Matrix) -> None:
        """Adds to the covariance from a row on: a vector to the diagonal, or a square block."""
        n = variances.shape[0]
        block = self.covariance[first : first + n, first : first + n]
        block += np.diag(variances) if variances.ndim == 1 else variances

    def test(self, residual: Matrix, rows: Matrix, noise: Matrix) -> float:
        """Normalised innovation squared of a residual (m,) with its Jacobian (m, size) and covariance (m, m)."""
        # Innovation: r^T S^-1 r, S = H P H^T + R, by Cholesky (Bar-Shalom, Li, Kirubarajan 2001, 5.4).
        _, solved, problem = self._solve(rows @ self.covariance @ rows.T + noise, residual)
        return float(residual @ solved) if problem == 0 else inf

    def update(self, residual: Matrix, rows: Matrix, noise: Matrix) -> Matrix:
        """Applies a measurement update; returns the estimated error, shape (size,)."""
        # Update: K = P H^T S^-1, dx = K r, P <- (I - K H) P (I - K H)^T + K R K^T (Joseph form).
        found, covariance = self._update(np.zeros(self.size), self.covariance, residual, noise, rows)
        self.covariance = covariance
        return np.asarray(found, dtype=np.float64)

    def copy_floor(self, variance_m2: float) -> None:
        """Resets the floor to the measured distance below; its error is that of the height and of the range."""
        whole = self.covariance
        whole[FLOOR, :] = whole[2, :]
        whole[:, FLOOR] = whole[:, 2]
        whole[FLOOR, FLOOR] = whole[2, 2] + variance_m2


_NO_ERROR: Final[Matrix] = np.zeros(SIZE)
_UNCHANGED: Final[Matrix] = np.eye(SIZE)
