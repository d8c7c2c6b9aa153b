"""A stereo odometer on a flight through a simulated world, judged by the truth."""

import time
from collections import Counter
from collections.abc import Iterable

import numpy as np
from tests.onboard.algorithms.vision.flights import Pair

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel
from gloc3.evaluation.trajectory import Array, Trajectory
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.vision.feature_message import odometry_of
from gloc3_onboard.algorithms.vision.stereo_motion import BEGUN, KeyFrameMotion
from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer
from gloc3_sitl.world.rig import FRONT_LEFT, FRONT_RIGHT

BOUND_95 = 12.59
"""Of six squared normal errors 95 % are below it."""


def follow(chain: OdometryChain, motion: KeyFrameMotion) -> Array:
    """Where the body is at the end of one more motion."""
    chain.add(odometry_of(motion, "stereo"), motion.t_s)
    return np.array(chain.position_m)


class Trial:
    """What an odometer made of a flight."""

    def __init__(
        self,
        path: Trajectory,
        pairs: Iterable[Pair],
        models: tuple[CameraModel, CameraModel] = (FRONT_LEFT, FRONT_RIGHT),
    ) -> None:
        self.costs_ms: list[float] = []
        self.squares: list[float] = []
        """Squared errors of the motions since their key frames, by their covariances; 6 is honest."""
        self.wrong_m: list[float] = []
        """Errors of those motions."""
        self.reasons: Counter[str] = Counter()
        odometer, chain = StereoOdometer(*models), OdometryChain()
        index = {t_s: n for n, t_s in enumerate(path.t_s.tolist())}
        poses = []
        for n, pair in enumerate(pairs):
            begin_s = time.thread_time()
            motion = odometer.update(pair.left, pair.right, pair.t_s)
            self.costs_ms.append(1e3 * (time.thread_time() - begin_s))
            poses.append((follow(chain, motion), matrix(chain.attitude)))
            if not motion.is_valid and motion.reason != BEGUN:
                self.reasons.update([motion.reason])
            elif motion.is_valid:
                self._judge(motion, path, index[motion.reference_t_s], n)
        self.truth = path.select(slice(0, len(poses)))
        self.estimate = Trajectory(
            t_s=self.truth.t_s,
            position_m=np.array([position for position, _ in poses]),
            world_from_body=np.array([rotation for _, rotation in poses]),
        )

    def _judge(self, motion: KeyFrameMotion, path: Trajectory, key: int, now: int) -> None:
        back = path.world_from_body[key].T
        error = np.empty(6)
        error[:3] = motion.position_m - back @ (path.position_m[now] - path.position_m[key])
        turn = (back @ path.world_from_body[now]).T @ motion.rotation
        error[3:] = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
        self.squares.append(float(error @ np.linalg.solve(motion.covariance, error)))
        self.wrong_m.append(float(np.linalg.norm(error[:3])))


def zero(path: Trajectory) -> Trajectory:
    """The control that never moves."""
    rest: Array = np.tile(path.world_from_body[0], (len(path), 1, 1))
    return Trajectory(t_s=path.t_s, position_m=np.tile(path.position_m[0], (len(path), 1)), world_from_body=rest)


def constant(path: Trajectory, begun: int = 30) -> Trajectory:
    """The control that goes on as the vehicle did in its first two seconds."""
    speed = (path.position_m[begun] - path.position_m[0]) / (path.t_s[begun] - path.t_s[0])
    on = path.position_m[0] + (path.t_s - path.t_s[0])[:, None] * speed
    return Trajectory(t_s=path.t_s, position_m=on, world_from_body=zero(path).world_from_body)
