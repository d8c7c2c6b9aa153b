"""DP: points around the vehicle, from the pictures of a depth camera."""

from collections.abc import Sequence
from typing import Annotated

from gloc3.camera.model import misfit
from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import DepthImage, PointCloud
from gloc3_onboard.algorithms.vision.depth_points import DepthPoints
from gloc3_onboard.sensors.checks.depth_check import depth_fault
from gloc3_onboard.sensors.devices import Rig, calibrated


class DepthCloudSettings(Settings, frozen=True):
    """Settings of the cloud of a depth camera."""

    most_points: Annotated[int, Bounds(100, 1_000_000)] = 20_000
    """Points of a picture, at most; pixels in between are left out."""


class DepthCloudProcessor(DataProcessor[DepthCloudSettings]):
    """Places each picture's pixels on the body; a picture that is not valid makes a cloud that is not."""

    loggable = ("pictures", "refused", "points", "reason")

    depth = Input(DepthImage)
    cloud = Output(PointCloud, frame="frd")

    def __init__(self, rig: Rig) -> None:
        self.pictures = self.refused = self.points = 0
        self.reason = ""
        self._rig = rig
        self._found: DepthPoints | None = None

    def start(self) -> None:
        """Waits for the first picture, which says of which camera it is."""
        self._found = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One cloud for each picture."""
        results: list[Result] = []
        for envelope in inbox.new(self.depth):
            self.pictures += 1
            cloud = self._cloud(envelope.payload)
            self.points, self.reason = len(cloud.data) // 12, cloud.reason
            self.refused += not cloud.is_valid
            results.append(self.cloud.report(cloud, t_s=envelope.t_s))
        return results

    def _cloud(self, depth: DepthImage) -> PointCloud:
        if problem := depth_fault(depth):
            return PointCloud(sensor=depth.camera, data=b"", is_valid=False, reason=problem)
        if self._found is None:
            self._found = DepthPoints(calibrated(self._rig, depth.camera), self.settings.most_points)
        model = self._found.model
        if problem := misfit(model, depth.width, depth.height):
            return PointCloud(sensor=depth.camera, data=b"", is_valid=False, reason=problem)
        points = self._found.points_frd_m(depth)
        return PointCloud(
            sensor=depth.camera,
            data=points.astype("<f4").tobytes(),
            origin_frd_m=model.position_frd_m,
            range_max_m=depth.range_max_m,
        )
