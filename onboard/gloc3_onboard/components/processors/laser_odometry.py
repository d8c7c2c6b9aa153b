"""DP: motion in the plane, from the laser scanner and the attitude."""

import math
from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.camera.opencv import load_opencv
from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.loading import load_modules
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, from_euler, to_euler
from gloc3.messages.perception import UNKNOWN_VARIANCE, LaserScan, Odometry, no_motion
from gloc3.messages.vehicle import AutopilotPose, HeightAboveGround
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserMotion, LaserOdometer, LaserOdometerSettings
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt
from gloc3_onboard.sensors.checks.recent import RecentAttitudes, RecentHeights
from gloc3_onboard.sensors.checks.silence import InputSilence

SOURCE: Final = "laser"
ATTITUDE_GAP_S: Final = 0.15
"""An attitude that is older than this at the time of a scan does not count."""
HEIGHT_GAP_S: Final = 0.3
TILT_STD_RAD: Final = 0.005
"""Of the roll and pitch by which a scan is levelled: accelerometers that are off by 0.05 m/s² lean an attitude by that."""
SHARED: Final = 0.9
DRIFT: Final = 0.2
"""What is wrong with a scan is wrong with the next, too; but scans are fitted into a map, and their errors do not add up:
found in flights of 60 m in the hold."""


class LaserOdometrySettings(Settings, frozen=True):
    """Settings of the laser odometry."""

    mount_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the scanner on the body, in metres."""
    mount_yaw_deg: Annotated[float, Bounds(-180.0, 180.0)] = 0.0
    """Direction of its middle beam, clockwise from ahead, in degrees."""
    reach_m: Annotated[float, Bounds(1.0, 1000.0)] = 30.0
    """Length of path whose walls the map holds, in metres."""
    key_distance_m: Annotated[float, Bounds(0.05, 10.0)] = 0.5
    """Distance after which the map adds a scan, in metres…"""
    key_turn_deg: Annotated[float, Bounds(1.0, 170.0)] = 20.0
    """…or the turn, in degrees."""
    lowest_share: Annotated[float, Bounds(0.05, 1.0)] = 0.25
    """A scan of which less fits into the map is lost."""
    acceleration_m_s2: Annotated[float, Bounds(0.1, 50.0)] = 3.0
    """Largest acceleration of the vehicle, in m/s²: a match that needs more is refused."""
    turn_acceleration_deg_s2: Annotated[float, Bounds(5.0, 5000.0)] = 340.0
    """Largest turn acceleration of the vehicle, in degrees/s²."""
    speed_m_s: Annotated[float, Bounds(0.1, 100.0)] = 20.0
    """Largest speed of the vehicle, in m/s."""
    turn_rate_deg_s: Annotated[float, Bounds(5.0, 3000.0)] = 340.0
    """Largest turn rate of the vehicle, in degrees/s."""
    stamp_jitter_s: Annotated[float, Bounds(0.0, 1.0)] = 0.02
    """How wrong the time between two scans may be, in seconds."""


class LaserOdometryProcessor(DataProcessor[LaserOdometrySettings]):
    """Reports for each scan the motion of the body since a key scan; invalid with a reason where it cannot."""

    loggable = ("scans", "refused", "degenerate", "undecided", "reason")

    laser = Input(LaserScan, Keep.ALL)
    autopilot_pose = Input(AutopilotPose, Keep.ALL)
    autopilot_attitude = Input(AutopilotPose, Keep.ALL)
    height = Input(HeightAboveGround, Keep.ALL)
    odometry = Output(Odometry)

    def __init__(self) -> None:
        self.scans = self.refused = self.degenerate = self.undecided = 0
        self.reason = ""

    def initialize(self, settings: LaserOdometrySettings) -> None:
        """Adopts the settings and loads the odometer."""
        load_modules("scipy.spatial")
        load_opencv()
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins without a past."""
        given = self.settings
        settings = LaserOdometerSettings(
            reach_m=given.reach_m,
            key_distance_m=given.key_distance_m,
            key_turn_rad=math.radians(given.key_turn_deg),
            lowest_share=given.lowest_share,
            acceleration_m_s2=given.acceleration_m_s2,
            turn_acceleration_rad_s2=math.radians(given.turn_acceleration_deg_s2),
            speed_m_s=given.speed_m_s,
            turn_rate_rad_s=math.radians(given.turn_rate_deg_s),
            stamp_jitter_s=given.stamp_jitter_s,
        )
        self._odometer = LaserOdometer(settings, Mount(given.mount_frd_m, math.radians(given.mount_yaw_deg)))
        self._attitudes, self._heights = RecentAttitudes(ATTITUDE_GAP_S), RecentHeights(HEIGHT_GAP_S)
        self._silence = InputSilence()
        self._down_m = self._floor_down_m = math.nan

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One report for each scan, and one a second where none comes."""
        self._attitudes.add(inbox.new(self.autopilot_pose), inbox.new(self.autopilot_attitude))
        self._heights.add(inbox.new(self.height))
        if (pose := inbox.latest(self.autopilot_pose)) is not None:
            attitude = inbox.latest(self.autopilot_attitude)
            is_placed = attitude is None or attitude.t_s < pose.t_s
            self._down_m = pose.payload.position_ned_m[2] if is_placed else math.nan
        results: list[Result] = []
        for envelope in inbox.new(self.laser):
            self._silence.end(now_s)
            results.append(self.odometry.report(self._reported(self._match(envelope)), t_s=envelope.t_s))
        if self._silence.is_due(now_s):
            results.append(self._reported(no_motion(SOURCE, now_s, "no scan received", is_level=True)))
        return results

    def _match(self, envelope: Envelope[LaserScan]) -> Odometry:
        scan, t_s = envelope.payload, envelope.t_s
        self.scans += 1
        attitude = self._attitudes.at(t_s)
        if attitude is None:
            return no_motion(SOURCE, t_s, "there is no attitude at the time of the scan", is_level=True)
        roll, pitch, yaw = to_euler(attitude)
        found = self._odometer.update(scan, t_s, Tilt(roll, pitch, self._height_m(t_s, roll, pitch)), yaw)
        self.degenerate += found.is_degenerate
        self.undecided += found.alternatives > 0
        return odometry_of(found, roll, pitch)

    def _height_m(self, t_s: float, roll: float, pitch: float) -> float | None:
        """Of the body above the floor: as it is measured, or else above where the floor was last."""
        slant_m = self._heights.at(t_s)
        if math.isfinite(slant_m):
            height_m = slant_m * math.cos(roll) * math.cos(pitch)
            self._floor_down_m = self._down_m + height_m
            return height_m
        height_m = self._floor_down_m - self._down_m
        return height_m if math.isfinite(height_m) else None

    def _reported(self, found: Odometry) -> Odometry:
        self.reason = found.reason
        self.refused += not found.is_valid
        return found


def odometry_of(found: LaserMotion, roll_rad: float, pitch_rad: float) -> Odometry:
    """The odometer's motion as a message; roll and pitch are known but not measured by it, nor is height."""
    rows = [[UNKNOWN_VARIANCE if row == column else 0.0 for column in range(6)] for row in range(6)]
    reported = (0, 1, 5)
    for row, values in zip(reported, found.covariance.tolist(), strict=True):
        for column, value in zip(reported, values, strict=True):
            rows[row][column] = value
    # The error of roll or pitch turns a levelled scan about the leaning axis, whose share along down is the sine of the lean.
    rows[5][5] += (TILT_STD_RAD * math.hypot(math.sin(roll_rad), math.sin(pitch_rad))) ** 2
    return Odometry(
        source=SOURCE,
        reference_t_s=found.reference_t_s,
        position_m=(found.motion.x_m, found.motion.y_m, 0.0),
        reference_from_frd=from_euler(roll_rad, pitch_rad, found.motion.yaw_rad),
        covariance=[value for row in rows for value in row],
        is_level=True,
        is_valid=found.is_valid,
        reason=found.reason,
        quality=found.quality,
        shared=SHARED,
        drift=DRIFT,
    )
