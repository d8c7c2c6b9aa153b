"""DP: obstacles around the vehicle, from the laser scanner and the pose."""

import math
from collections.abc import Sequence

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.messages.envelope import Envelope
from gloc3.messages.perception import LaserScan
from gloc3.messages.vehicle import HeightAboveGround, ObstacleScan, Pose
from gloc3_onboard.algorithms.scan_matching.scan_placement import ScanPlacementSettings, place_scan
from gloc3_onboard.sensors.checks.obstacles import obstacles_of


class ObstacleSettings(ScanPlacementSettings, frozen=True):
    """Settings of the obstacle processor."""


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
            self.closest_m = found.closest_m
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
        placed = place_scan(envelope, pose, height, settings)
        if placed is None:
            return ObstacleScan(points_ne_m=[], is_valid=False, reason="there is no valid pose at the time of the scan")
        return obstacles_of(scan, placed.tilt, settings.mount, placed.pose, placed.motion, placed.height_m)
