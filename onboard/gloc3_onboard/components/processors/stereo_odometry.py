"""DP: motion of the body from the features of the stereo pair."""

from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.perception import Features, ImuSample, Odometry, no_motion
from gloc3_onboard.sensors.checks.silence import InputSilence
from gloc3_onboard.sensors.devices import Rig, calibrated

SOURCE: Final = "stereo"


class StereoOdometrySettings(Settings, frozen=True):
    """Settings of the stereo odometry."""

    left: str = "front_left"
    """Name of the left camera, as it was calibrated."""
    right: str = "front_right"
    """Name of the right one."""
    ray_px: Annotated[float, Bounds(0.01, 5.0)] = 0.12
    """Standard deviation of where a feature is found again, in pixels."""
    disparity_px: Annotated[float, Bounds(0.01, 5.0)] = 0.15
    """The same of its disparity."""
    calibration_px: Annotated[float, Bounds(0.0, 5.0)] = 0.0
    """Standard deviation of what the calibration is off by, in pixels; above 0 a constant in the disparities is
    estimated in flight, and the covariance is wider."""
    std_max_m: Annotated[float, Bounds(0.001, 10.0)] = 0.1
    """With a standard deviation above it, in metres, a motion is not valid."""
    acceleration_max_m_s2: Annotated[float, Bounds(1.0, 1000.0)] = 20.0
    """A motion that would have taken more is not valid."""
    hold_s: Annotated[float, Bounds(0.0, 0.5)] = 0.3
    """With `inertial` bound: longest time without a motion, in seconds, that the gyros and the last speed bridge."""
    hold_m_s2: Annotated[float, Bounds(0.1, 100.0)] = 1.5
    """Standard deviation of each component of the body's acceleration meanwhile, in m/s²."""


class StereoOdometryProcessor(DataProcessor[StereoOdometrySettings]):
    """Reports for each set of features the motion of the body since a key frame; invalid with a reason where it cannot.

    With `inertial` bound to the topic of an inertial unit, a motion that contradicts its gyros is not valid, and they
    bridge short times without one.
    """

    loggable = ("sets", "refused", "points", "reason")

    features = Input(Features, Keep.ALL)
    inertial = Input(ImuSample, Keep.ALL, 512, is_optional=True)
    odometry = Output(Odometry)

    def __init__(self, rig: Rig) -> None:
        self.sets = self.refused = self.points = 0
        self.reason = ""
        self._rig = rig

    def initialize(self, settings: StereoOdometrySettings) -> None:
        """Makes the odometer; refuses cameras that are not calibrated, or do not make a pair."""
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins without a past."""
        from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn
        from gloc3_onboard.algorithms.vision.feature_message import features_of, odometry_of
        from gloc3_onboard.algorithms.vision.stereo_motion import MotionOptions, StereoMotion
        from gloc3_onboard.algorithms.vision.stereo_rig import stereo_rig

        given = self.settings
        rig = stereo_rig(calibrated(self._rig, given.left), calibrated(self._rig, given.right))
        options = MotionOptions(
            ray_px=given.ray_px,
            disparity_px=given.disparity_px,
            calibration_px=given.calibration_px,
            std_max_m=given.std_max_m,
            acceleration_max_m_s2=given.acceleration_max_m_s2,
            hold_s=given.hold_s,
            hold_m_s2=given.hold_m_s2,
        )
        self._features_of, self._odometry_of = features_of, odometry_of
        self._gyro = GyroTurn()
        self._motion = StereoMotion(rig, options, self._gyro)
        self._silence = InputSilence()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One report for each set of features, and one a second where none come."""
        for sample in inbox.new(self.inertial):
            if sample.payload.is_valid:
                self._gyro.add(sample.t_s, sample.payload.rate_frd_rad_s)
        results: list[Result] = []
        for envelope in inbox.new(self.features):
            self._silence.end(now_s)
            self.sets += 1
            results.append(self.odometry.report(self._reported(self._track(envelope)), t_s=envelope.t_s))
        if self._silence.is_due(now_s):
            results.append(self._reported(no_motion(SOURCE, now_s, "no features received")))
        return results

    def _track(self, envelope: Envelope[Features]) -> Odometry:
        given = envelope.payload
        features = self._features_of(given, envelope.t_s) if given.is_valid else None
        if features is None:
            reason = "the features are damaged" if given.is_valid else given.reason or "the features are not valid"
            motion = self._motion.hold(envelope.t_s, reason)
            if motion is None:
                return no_motion(SOURCE, envelope.t_s, reason)
        else:
            motion = self._motion.update(features)
        self.points = motion.points
        return self._odometry_of(motion, SOURCE)

    def _reported(self, found: Odometry) -> Odometry:
        self.reason = found.reason
        self.refused += not found.is_valid
        return found
