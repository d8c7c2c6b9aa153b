"""Stereo odometry: the motion of the body from the pictures of two cameras, metric and in six degrees of freedom."""

import numpy as np

from gloc3.camera_geometry import Array
from gloc3.camera_model import CameraModel
from gloc3_onboard.vision.features import FeatureMatcher, MatcherOptions
from gloc3_onboard.vision.picture import Picture
from gloc3_onboard.vision.stereo_motion import Motion, MotionOptions, StereoMotion
from gloc3_onboard.vision.stereo_rig import StereoRig


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
    """Motions put one behind the other: where the body is, in its axes at the begin."""

    def __init__(self) -> None:
        self._poses: dict[float, tuple[Array, Array]] = {}
        self._last: tuple[Array, Array] = (np.zeros(3), np.eye(3))

    def add(self, motion: Motion) -> tuple[Array, Array]:
        """Position and rotation (begin from body); a motion that is not valid, or has lost its begin, adds nothing."""
        if motion.is_valid:
            position, rotation = self._poses.get(motion.reference_t_s, self._last)
            self._last = (position + rotation @ motion.position_m, rotation @ motion.rotation)
            # No motion is ever told from before the last one's key frame.
            self._poses = {t_s: pose for t_s, pose in self._poses.items() if t_s >= motion.reference_t_s}
            self._poses[motion.t_s] = self._last
        return self._last
