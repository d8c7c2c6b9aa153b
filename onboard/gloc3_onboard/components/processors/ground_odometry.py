"""DP: motion over the ground, from the downward camera, the attitude and the height."""

from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3
from gloc3.messages.perception import Odometry
from gloc3.messages.vehicle import AutopilotPose, HeightAboveGround, Image
from gloc3_onboard.sensors.checks.frame_check import complaint
from gloc3_onboard.sensors.checks.recent import RecentAttitudes, RecentHeights
from gloc3_onboard.sensors.checks.silence import InputSilence
from gloc3_onboard.sensors.devices import Rig, calibrated

ATTITUDE_GAP_S: Final = 0.15
"""An attitude that is older than this at the time of a picture does not count."""
HEIGHT_GAP_S: Final = 0.2


class GroundOdometrySettings(Settings, frozen=True):
    """Settings of the ground odometry."""

    camera: str = "ground"
    """Name of the downward camera, as in its calibration."""
    height_noise_m: Annotated[float, Bounds(0.001, 1.0)] = 0.02
    """Standard deviation of one height, in metres."""
    height_scale_std: Annotated[float, Bounds(0.0, 0.2)] = 0.007
    """Standard deviation of the share by which all heights may be wrong."""
    is_slant: bool = True
    """The height is measured along the body's down axis, as a fixed range finder does, not vertically."""
    sensor_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the height sensor on the body, in metres."""
    tilt_std_rad: Annotated[float, Bounds(1e-5, 0.1)] = 0.003
    """Standard deviation of roll and pitch changes within a second, in radians."""
    yaw_std_rad: Annotated[float, Bounds(1e-5, 0.5)] = 0.02
    """The same of heading."""
    level_std_rad: Annotated[float, Bounds(1e-5, 0.2)] = 0.006
    """How wrong the attitude may say where down is, all the time, in radians."""
    slope_std: Annotated[float, Bounds(0.0001, 0.5)] = 0.015
    """How far the floor may be from level, as a tangent."""
    is_climb_told: bool = True
    """Whether climbs are reported, which rest on height and attitude; off where the fusion has the same height and a
    better attitude."""


class GroundOdometryProcessor(DataProcessor[GroundOdometrySettings]):
    """Reports for each picture the motion of the body since a key frame; invalid with a reason where it cannot."""

    loggable = ("pictures", "refused", "reason")

    image = Input(Image, Keep.ALL)
    autopilot_pose = Input(AutopilotPose, Keep.ALL)
    autopilot_attitude = Input(AutopilotPose, Keep.ALL)
    height = Input(HeightAboveGround, Keep.ALL)
    odometry = Output(Odometry)

    def __init__(self, rig: Rig) -> None:
        self.pictures = self.refused = 0
        self.reason = ""
        self._rig = rig

    def initialize(self, settings: GroundOdometrySettings) -> None:
        """Makes the odometer; refuses a camera that is not calibrated."""
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins without a past."""
        from gloc3_onboard.algorithms.vision.ground_odometer import GroundOdometer, GroundSettings
        from gloc3_onboard.algorithms.vision.picture import pixels_of

        given = self.settings
        settings = GroundSettings(
            height_noise_m=given.height_noise_m,
            height_scale_std=given.height_scale_std,
            is_slant=given.is_slant,
            sensor_frd_m=given.sensor_frd_m,
            tilt_std_rad=given.tilt_std_rad,
            yaw_std_rad=given.yaw_std_rad,
            level_std_rad=given.level_std_rad,
            slope_std=given.slope_std,
            is_climb_reported=given.is_climb_told,
        )
        self._pixels_of = pixels_of
        self._odometer = GroundOdometer(calibrated(self._rig, given.camera), settings)
        self._attitudes, self._heights = RecentAttitudes(ATTITUDE_GAP_S), RecentHeights(HEIGHT_GAP_S)
        self._silence = InputSilence()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One report for each picture, and one a second where none comes."""
        self._attitudes.add(inbox.new(self.autopilot_pose), inbox.new(self.autopilot_attitude))
        self._heights.add(inbox.new(self.height))
        results: list[Result] = []
        for envelope in inbox.new(self.image):
            self._silence.end(now_s)
            results.append(self.odometry.report(self._reported(self._track(envelope)), t_s=envelope.t_s))
        if self._silence.is_due(now_s):
            results.append(self._reported(self._odometer.without_picture(now_s, "no picture received")))
        return results

    def _track(self, envelope: Envelope[Image]) -> Odometry:
        image, t_s = envelope.payload, envelope.t_s
        self.pictures += 1
        reason = complaint(image)
        if reason:
            return self._odometer.without_picture(t_s, reason)
        attitude = self._attitudes.at(t_s)
        if attitude is None:
            return self._odometer.without_picture(t_s, "there is no attitude at the time of the picture")
        return self._odometer.update(self._pixels_of(image), t_s, attitude, self._heights.at(t_s))

    def _reported(self, found: Odometry) -> Odometry:
        self.reason = found.reason
        self.refused += not found.is_valid
        return found
