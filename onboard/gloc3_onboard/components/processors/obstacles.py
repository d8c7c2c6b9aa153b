"""DP: obstacles around the vehicle, from the laser scanner and the pose."""

import math
from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, rotate_back, to_euler
from gloc3.messages.perception import LaserScan
from gloc3.messages.vehicle import HeightAboveGround, ObstacleScan, Pose
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt
from gloc3_onboard.sensors.checks.obstacles import obstacles_of


class ObstacleSettings(Settings, frozen=True):
    """Settings of the obstacle processor."""

    mount_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the scanner on the body, in metres."""
    mount_yaw_deg: Annotated[float, Bounds(-180.0, 180.0)] = 0.0
    """Direction of its middle beam, clockwise from ahead, in degrees."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = 0.25
    """A pose that is older than this at the time of a scan does not count."""
    height_limit_s: Annotated[float, Bounds(0.05, 5.0)] = 0.5
    """A height that is older does not count; without one, the floor may be taken for an obstacle when the body tilts."""


class ObstacleProcessor(DataProcessor[ObstacleSettings]):
    """Places what each scan has hit; nothing seen is a valid answer, a bad scan or a missing pose is not."""

    loggable = ("scans", "refused", "closest_m", "reason")

    laser = Input(LaserScan)
    pose = Input(Pose)
    height = Input(HeightAboveGround)
    obstacles = Output(ObstacleScan, frame="ned")

    def __init__(self) -> None:
        self.scans = self.refused = 0
        self.closest_m = math.inf
        """Distance of the nearest thing in the last scan."""
        self.reason = ""

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One report for each scan."""
        results: list[Result] = []
        for envelope in inbox.new(self.laser):
            self.scans += 1
            found = self._place(envelope, inbox.latest(self.pose), inbox.latest(self.height))
            self.reason = found.reason
            self.refused += not found.is_valid
            self.closest_m = min((distance_m for distance_m in found.sectors_m if distance_m >= 0.0), default=math.inf)
            results.append(self.obstacles.report(found, t_s=envelope.t_s))
        return results

    def _place(
        self,
        envelope: Envelope[LaserScan],
        pose: Envelope[Pose] | None,
        height: Envelope[HeightAboveGround] | None,
    ) -> ObstacleScan:
        scan, settings = envelope.payload, self.settings
        if not scan.is_valid:
            return ObstacleScan(points_ne_m=[], is_valid=False, reason=scan.reason or "the scanner reports it")
        if pose is None or not pose.payload.is_valid or abs(envelope.t_s - pose.t_s) > settings.pose_limit_s:
            return ObstacleScan(points_ne_m=[], is_valid=False, reason="there is no valid pose at the time of the scan")
        place = pose.payload
        roll, pitch, yaw = to_euler(place.ned_from_frd)
        above_m = None
        if height is not None and height.payload.is_valid and envelope.t_s - height.t_s <= settings.height_limit_s:
            above_m = height.payload.height_m * math.cos(roll) * math.cos(pitch)
        later_s = envelope.t_s - pose.t_s
        north, east, down = (
            at + speed * later_s for at, speed in zip(place.position_ned_m, place.velocity_ned_m_s, strict=True)
        )
        rate = place.rate_frd_rad_s[2]
        forward, right, _ = rotate_back(place.ned_from_frd, place.velocity_ned_m_s)
        return obstacles_of(
            scan,
            Tilt(roll, pitch, above_m),
            Mount(settings.mount_frd_m, math.radians(settings.mount_yaw_deg)),
            Planar(north, east, yaw + rate * later_s),
            Planar(forward, right, rate).part(scan.duration_s),
            -down,
        )
