"""A hand that moves a camera with an inertial unit before a board: smooth, known at any time."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gloc3_onboard.algorithms.calibration.camera_imu_fit import ImuMotion

Floats = NDArray[np.float64]

STEP_S: Final = 1e-4
GRAVITY: Final = 9.80665


class Hand(NamedTuple):
    """A motion: the camera sways and turns about all axes around a mean pose before a board that hangs upright."""

    mean: Floats
    """Rotation vector and translation of `camera_from_board`."""
    camera_from_imu: Rotation
    imu_in_camera_m: Floats
    seed: int = 0
    turn_rad: float = 0.25
    sway_m: float = 0.06

    def poses(self, times_s: Floats) -> Floats:
        """Rotation vectors and translations of `camera_from_board`, (n, 6)."""
        random = np.random.default_rng(self.seed)
        waves = np.zeros((len(times_s), 6))
        for column in range(6):
            for hertz in (0.31, 0.74, 1.3):
                wave = np.sin(2.0 * np.pi * hertz * random.uniform(0.9, 1.1) * times_s + random.uniform(0.0, 6.3))
                waves[:, column] += wave / (1.0 + hertz)
        turned = Rotation.from_rotvec(self.turn_rad * waves[:, :3]) * Rotation.from_rotvec(self.mean[:3])
        return np.column_stack((turned.as_rotvec(), self.mean[3:] + self.sway_m * waves[:, 3:]))

    def imu(self, times_s: Floats) -> tuple[Rotation, Floats]:
        """`board_from_imu` and the unit's places on the board, (n, 3)."""
        poses = self.poses(times_s)
        board_from_camera = Rotation.from_rotvec(poses[:, :3]).inv()
        places = board_from_camera.apply(self.imu_in_camera_m - poses[:, 3:])
        return board_from_camera * self.camera_from_imu, places

    def samples(self, times_s: Floats, gyro_noise: float = 2e-3, force_noise: float = 0.03, seed: int = 0) -> ImuMotion:
        """What the unit measures at these times, with noise and biases."""
        before, at, after = (self.imu(times_s + shift) for shift in (-STEP_S, 0.0, STEP_S))
        rates = (before[0].inv() * after[0]).as_rotvec() / (2.0 * STEP_S)
        accelerations = (after[1] - 2.0 * at[1] + before[1]) / STEP_S**2
        gravity = np.array([0.0, -GRAVITY, 0.0])  # the board's y is up
        forces = at[0].inv().apply(accelerations - gravity)
        random = np.random.default_rng([self.seed, seed])
        rates = rates + np.array([0.004, -0.006, 0.002]) + random.normal(0.0, gyro_noise, rates.shape)
        forces = forces + np.array([0.05, -0.03, 0.08]) + random.normal(0.0, force_noise, forces.shape)
        return ImuMotion(times_s=times_s, rates_rad_s=rates, forces_m_s2=forces)


HAND: Final = Hand(
    mean=np.array([np.pi, 0.0, 0.0, -0.1, 0.07, 0.45]),
    camera_from_imu=Rotation.from_euler("xyz", [0.02, -0.03, 0.05])
    * Rotation.from_matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    imu_in_camera_m=np.array([0.03, -0.02, -0.05]),
)
"""Half a metre before a board; the unit's axes are forward, right, down, a little awry."""
