"""Motion of the body past the last measured one, for a short time: at its speed, with the gyros' turn."""

import numpy as np

from gloc3.camera.geometry import Array
from gloc3_onboard.algorithms.odometry.gyro_turn import InertialTurn


class HeldMotion:
    """Leads on from the last motion since a key frame.

    Args:
        longest_s: longest time past the last motion.
        acceleration_m_s2: standard deviation of each component of the body's acceleration.
    """

    def __init__(self, longest_s: float, acceleration_m_s2: float) -> None:
        self._longest_s, self._acceleration = longest_s, acceleration_m_s2
        self.begin(-np.inf)

    def begin(self, t_s: float) -> None:
        """A key frame of which nothing else is known."""
        self._place(t_s, np.zeros(3), np.eye(3), np.zeros((6, 6)))
        self._speed_m_s: Array | None = None
        self._speed_variance = self._step_s = 0.0

    def _place(self, t_s: float, position_m: Array, rotation: Array, covariance: Array) -> None:
        self._t_s, self._position, self._rotation, self._covariance = t_s, position_m, rotation, covariance

    def follow(self, t_s: float, position_m: Array, rotation: Array, covariance: Array) -> None:
        """Takes in a measured motion since the key frame.

        Args:
            t_s: its end.
            position_m: of the body in its axes at the key frame, (3,).
            rotation: key frame from now, (3, 3).
            covariance: 6 by 6, as in `Odometry`.
        """
        self._step_s = t_s - self._t_s
        # Mean speed of the step, with the errors of both its ends.
        self._speed_m_s = (position_m - self._position) / self._step_s
        both = float(np.trace(covariance[:3, :3]) + np.trace(self._covariance[:3, :3]))
        self._speed_variance = both / 3.0 / self._step_s**2
        self._place(t_s, position_m, rotation, covariance)

    def renew(self, t_s: float, rotation: Array) -> None:
        """Makes the pose at the last motion, or a later one that it led to, the key frame.

        Args:
            t_s: of the new key frame.
            rotation: old key frame from the new one, (3, 3).
        """
        if self._speed_m_s is not None:
            self._speed_m_s = rotation.T @ self._speed_m_s
            self._speed_variance += (self._acceleration * (t_s - self._t_s)) ** 2
        self._place(t_s, np.zeros(3), np.eye(3), np.zeros((6, 6)))

    def ahead(self, t_s: float, turn: InertialTurn | None) -> tuple[Array, Array, Array] | None:
        """Position, rotation and covariance since the key frame, as `follow` takes them; None if it is too long since.

        Args:
            t_s: when.
            turn: by the gyros, since the last motion.
        """
        after_s = t_s - self._t_s
        if turn is None or self._speed_m_s is None or not 0.0 < after_s <= self._longest_s:
            return None
        # p + v dt, the turn once more; v is the mean of the last step: half a step older than its end.
        along = np.eye(6)
        along[3:, 3:] = turn.rotation.T
        covariance = along @ self._covariance @ along.T
        bend_m = 0.5 * self._acceleration * after_s * (after_s + self._step_s)
        covariance[:3, :3] += (self._speed_variance * after_s**2 + bend_m**2) * np.eye(3)
        covariance[3:, 3:] += turn.variance_rad2 * np.eye(3)
        return self._position + self._speed_m_s * after_s, self._rotation @ turn.rotation, covariance
