"""DP: the vehicle's position from its lamp, seen by an external camera (paper §VI)."""

import math
from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, from_euler, rotate
from gloc3.messages.perception import PositionFix
from gloc3.messages.vehicle import HeightAboveGround, Image, Pose
from gloc3_onboard.sensors.checks.frame_check import complaint
from gloc3_onboard.sensors.checks.recent import RecentHeights
from gloc3_onboard.sensors.checks.silence import InputSilence
from gloc3_onboard.sensors.devices import Rig, calibrated

GAP_S: Final = 0.3
"""A height or a pose that is older than this at the time of a picture does not count."""


class OpticalFollowerSettings(Settings, frozen=True):
    """Settings of the optical follower."""

    camera: str = "tracker"
    """Name of the tracking camera, as in its calibration."""
    position_ned_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of its stand in the platform's frame, metres north, east and down."""
    euler_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch and heading of the stand, in degrees; a pitch below 0 looks down."""
    lever_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the lamp on the vehicle's body, in metres."""
    threshold_grey: Annotated[int, Bounds(10, 255)] = 200
    """The lamp is at least so bright in the picture."""
    floor_height_m: Annotated[float, Bounds(-1000.0, 1000.0)] = 0.0
    """How high the floor, that the vehicle's height counts from, is above the frame's origin, in metres."""
    sensor_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the height sensor on the body, in metres."""
    height_std_m: Annotated[float, Bounds(0.001, 10.0)] = 0.05
    """How well the height of the lamp is known from it, in metres."""
    is_range_told: bool = True
    """Whether that height also places the lamp along the line of sight; no where the fusion has the same height."""
    spot_std_px: Annotated[float, Bounds(0.001, 10.0)] = 0.3
    """How well the middle of the lamp is found in a picture, in pixels."""
    pointing_std_deg: Annotated[float, Bounds(0.0, 5.0)] = 0.03
    """Standard deviation of the camera's direction, in degrees."""
    step_m: Annotated[float, Bounds(0.01, 10.0)] = 0.3
    """Difference of height and pose above which an object below the vehicle is assumed, in metres; the pose is used
    then."""


class OpticalFollowerProcessor(DataProcessor[OpticalFollowerSettings]):
    """Reports for each picture the position of the lamp, with what is uncertain along the line of sight; or why it cannot."""

    loggable = ("pictures", "lost", "reason")

    image = Input(Image, Keep.ALL)
    height = Input(HeightAboveGround, Keep.ALL)
    pose = Input(Pose)
    position_fix = Output(PositionFix, frame="ned")

    def __init__(self, rig: Rig) -> None:
        self.pictures = self.lost = 0
        self.reason = ""
        self._rig = rig

    def initialize(self, settings: OpticalFollowerSettings) -> None:
        """Makes the follower; refuses a camera that is not calibrated."""
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins without a past."""
        from gloc3_onboard.algorithms.vision.optical_follower import FollowerSettings, OpticalFollower
        from gloc3_onboard.algorithms.vision.picture import pixels_of

        given = self.settings
        roll, pitch, yaw = map(math.radians, given.euler_deg)
        settings = FollowerSettings(
            position_ned_m=given.position_ned_m,
            ned_from_frd=from_euler(roll, pitch, yaw),
            lever_frd_m=given.lever_frd_m,
            threshold_grey=given.threshold_grey,
            spot_std_px=given.spot_std_px,
            pointing_std_rad=math.radians(given.pointing_std_deg),
            is_range_reported=given.is_range_told,
        )
        self._pixels_of = pixels_of
        self._follower = OpticalFollower(calibrated(self._rig, given.camera), settings)
        self._heights = RecentHeights(GAP_S)
        self._silence = InputSilence()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One report for each picture, and one a second where none comes."""
        self._heights.add(inbox.new(self.height))
        results: list[Result] = []
        for envelope in inbox.new(self.image):
            self._silence.end(now_s)
            fix = self._track(envelope, inbox.latest(self.pose))
            results.append(self.position_fix.report(self._reported(fix), t_s=envelope.t_s))
        if self._silence.is_due(now_s):
            results.append(self._reported(self._follower.without_picture("no picture received")))
        return results

    def _track(self, envelope: Envelope[Image], pose: Envelope[Pose] | None) -> PositionFix:
        image = envelope.payload
        self.pictures += 1
        reason = complaint(image)
        if reason:
            return self._follower.without_picture(reason)
        down_m, std_m = self._down(envelope.t_s, pose)
        return self._follower.update(self._pixels_of(image), envelope.t_s, down_m, std_m)

    def _down(self, t_s: float, pose: Envelope[Pose] | None) -> tuple[float, float]:
        """How far the lamp is below the frame's origin, and how well that is known."""
        settings = self.settings
        is_posed = pose is not None and pose.payload.is_valid and abs(t_s - pose.t_s) <= GAP_S
        reported = pose.payload if pose is not None and is_posed else None
        arm = tuple(a - b for a, b in zip(settings.lever_frd_m, settings.sensor_frd_m, strict=True))
        lever_down = rotate(reported.ned_from_frd, (arm[0], arm[1], arm[2]))[2] if reported is not None else arm[2]
        cosine = rotate(reported.ned_from_frd, (0.0, 0.0, 1.0))[2] if reported is not None else 1.0
        by_height_m = -settings.floor_height_m - self._heights.at(t_s) * cosine + lever_down
        if reported is None:
            return by_height_m, settings.height_std_m
        by_pose_m = reported.position_ned_m[2] + rotate(reported.ned_from_frd, settings.lever_frd_m)[2]
        if abs(by_height_m - by_pose_m) <= settings.step_m:
            return by_height_m, settings.height_std_m
        return by_pose_m, max(reported.position_std_m[2], settings.height_std_m)

    def _reported(self, fix: PositionFix) -> PositionFix:
        self.reason = fix.reason
        self.lost += not fix.is_valid
        return fix
