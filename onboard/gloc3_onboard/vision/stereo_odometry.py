"""Stereo odometry: the motion of the body from the pictures of two cameras, metric and in six degrees of freedom."""

from typing import Final

import numpy as np

from gloc3.camera_geometry import Array
from gloc3.camera_model import CameraModel
from gloc3_onboard.vision.features import FeatureMatcher, MatcherOptions
from gloc3_onboard.vision.picture import Picture
from gloc3_onboard.vision.stereo_motion import Motion, MotionOptions, StereoMotion
from gloc3_onboard.vision.stereo_rig import StereoRig

_GAP_S: Final = 2.0


class StereoOdometer:
    """Pictures in, motions out.

    Args:
        left: the left camera, as calibrated.
        right: the right one.
        matching: how features are found and matched.
        motion: how motions are estimated.

    Raises:
        Refused: the cameras do not make a pair.
    """

    def __init__(
        self,
        left: CameraModel,
        right: CameraModel,
        matching: MatcherOptions | None = None,
        motion: MotionOptions | None = None,
    ) -> None:
        rig = StereoRig(left, right)
        self._matcher = FeatureMatcher(rig, matching)
        self._motion = StereoMotion(rig, motion)

    def update(self, left: Picture, right: Picture, t_s: float) -> Motion:
        """The motion of the body since the key frame.

        Args:
            left: grey values, rows by columns.
            right: the same of the right camera, taken at the same time.
            t_s: when; must grow.
        """
        return self._motion.update(self._matcher.update(left, right, t_s))


class MotionChain:
    """Motions put one behind the other: where the body is, in its axes at the begin.

    Over a gap, after which an odometer begins with a new key frame, the body is held to have gone on as it did before.
    """

    def __init__(self) -> None:
        self._poses: dict[float, tuple[Array, Array]] = {}
        self._last: tuple[Array, Array] = (np.zeros(3), np.eye(3))
        self._last_s: float | None = None
        self._speed_m_s: Array = np.zeros(3)

    def add(self, motion: Motion) -> tuple[Array, Array]:
        """Position and rotation (begin from body) at the time of a motion."""
        before, rotation = self._last
        after_s = 0.0 if self._last_s is None else motion.t_s - self._last_s
        if not motion.is_valid:
            return before + self._speed_m_s * after_s if 0.0 < after_s < _GAP_S else before, rotation
        base = self._poses.get(motion.reference_t_s)
        if base is None:
            base = (before + self._speed_m_s * min(after_s, _GAP_S), rotation)
        self._last = (base[0] + base[1] @ motion.position_m, base[1] @ motion.rotation)
        if after_s > 0.0 and motion.t_s > motion.reference_t_s:
            self._speed_m_s = (self._last[0] - before) / after_s
        self._last_s = motion.t_s
        # No motion is ever told from before the last one's key frame.
        self._poses = {t_s: pose for t_s, pose in self._poses.items() if t_s >= motion.reference_t_s}
        self._poses[motion.t_s] = self._last
        return self._last
