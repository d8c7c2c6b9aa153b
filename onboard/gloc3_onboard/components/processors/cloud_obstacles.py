"""DP: obstacles around the vehicle, from point clouds and the pose."""

import math
from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds
from gloc3.messages.envelope import Envelope
from gloc3.messages.perception import PointCloud
from gloc3.messages.vehicle import HeightAboveGround, ObstacleScan, Pose
from gloc3_onboard.algorithms.mapping.obstacle_memory import ObstacleMemory
from gloc3_onboard.algorithms.scan_matching.scan_placement import PlacementSettings, place_body
from gloc3_onboard.algorithms.scan_matching.scan_points import cloud_fault, level_points
from gloc3_onboard.sensors.checks.obstacles import obstacles_at


class CloudObstacleSettings(PlacementSettings, frozen=True):
    """Settings of the obstacle processor of point clouds."""

    band_m: Annotated[float, Bounds(0.1, 10.0)] = 0.5
    """What is so far above or below the vehicle's middle is an obstacle, in metres."""
    memory_s: Annotated[float, Bounds(0.0, 60.0)] = 10.0
    """What is out of view is kept for so long, in seconds; what the sensor sees through is dropped at once."""
    range_m: Annotated[float, Bounds(1.0, 60.0)] = 8.0
    """What is farther away is no obstacle yet, in metres."""
    fewest_points: Annotated[int, Bounds(1, 1000)] = 3
    """Points in a cell of 0.1 m that make an obstacle; fewer are noise."""


class CloudObstacleProcessor(DataProcessor[CloudObstacleSettings]):
    """Reports what each cloud shows at the vehicle's height, and what earlier ones have shown beside the view."""

    loggable = ("clouds", "refused", "closest_m", "reason")

    cloud = Input(PointCloud, Keep.ALL)
    pose = Input(Pose)
    height = Input(HeightAboveGround)
    obstacles = Output(ObstacleScan, frame="ned")

    def __init__(self) -> None:
        self.clouds = self.refused = 0
        self.closest_m = math.inf
        """Distance of the nearest thing."""
        self.reason = ""
        self._reset_counter = 0

    def start(self) -> None:
        """Begins without a memory."""
        settings = self.settings
        self._memory = ObstacleMemory(settings.memory_s, settings.range_m, settings.band_m, settings.fewest_points)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One report for each cloud."""
        results: list[Result] = []
        for envelope in inbox.new(self.cloud):
            self.clouds += 1
            found = self._place(envelope, inbox.latest(self.pose), inbox.latest(self.height))
            self.reason = found.reason
            self.refused += not found.is_valid
            self.closest_m = found.closest_m
            results.append(self.obstacles.report(found, t_s=envelope.t_s))
        return results

    def _place(
        self,
        envelope: Envelope[PointCloud],
        pose: Envelope[Pose] | None,
        height: Envelope[HeightAboveGround] | None,
    ) -> ObstacleScan:
        cloud = envelope.payload
        if problem := cloud_fault(cloud):
            return ObstacleScan(points_ne_m=[], is_valid=False, reason=problem)
        placed = place_body(envelope.t_s, pose, height, self.settings)
        if placed is None or pose is None:
            return ObstacleScan(
                points_ne_m=[], is_valid=False, reason="there is no valid pose at the time of the cloud"
            )
        if pose.payload.reset_counter != self._reset_counter:
            self._reset_counter = pose.payload.reset_counter
            self._memory.clear()
        seen_rad = self._memory.add(level_points(cloud, placed.tilt, placed.twist), placed.pose, envelope.t_s)
        range_m = min(cloud.range_max_m or math.inf, self.settings.range_m)
        return obstacles_at(self._memory.around(placed.pose), seen_rad, placed.pose, placed.height_m, range_m)
