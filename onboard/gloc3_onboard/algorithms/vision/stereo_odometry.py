"""Stereo odometry: the motion of the body from the pictures of two cameras, metric and in six degrees of freedom."""

from gloc3.camera.model import CameraModel
from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn
from gloc3_onboard.algorithms.vision.features import FeatureMatcher, MatcherOptions
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.stereo_motion import KeyFrameMotion, MotionOptions, StereoMotion
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig


class StereoOdometer:
    """Stereo odometer: pictures in, motions out.

    Args:
        left: the left camera, as calibrated.
        right: the right one.
        matching: how features are found and matched.
        motion: how motions are estimated.
        gyro: gets the samples of an inertial unit before the pictures; None without one.

    Raises:
        Refused: the cameras do not make a pair.
    """

    def __init__(
        self,
        left: CameraModel,
        right: CameraModel,
        matching: MatcherOptions | None = None,
        motion: MotionOptions | None = None,
        gyro: GyroTurn | None = None,
    ) -> None:
        rig = StereoRig(left, right)
        self._matcher = FeatureMatcher(rig, matching, gyro)
        self._motion = StereoMotion(rig, motion, gyro)

    def update(self, left: Picture, right: Picture, t_s: float) -> KeyFrameMotion:
        """The motion of the body since the key frame.

        Args:
            left: grey values, rows by columns.
            right: the same of the right camera, taken at the same time.
            t_s: when; must grow.
        """
        return self._motion.update(self._matcher.update(left, right, t_s))
