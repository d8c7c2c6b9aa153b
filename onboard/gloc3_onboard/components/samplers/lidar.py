"""SS: a 3D scanner."""

from collections.abc import Sequence
from typing import Annotated

import msgspec

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import PointCloud
from gloc3_onboard.algorithms.scan_matching.scan_points import cloud_fault
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Lidar, opened


class LidarSettings(Settings, frozen=True):
    """Settings of the sampler of a 3D scanner."""

    silent_s: Annotated[float, Bounds(0.05, 60.0)] = 1.0
    """Time without a turn after which the scanner counts as silent, in seconds."""


class LidarSampler(SensorSampler[LidarSettings]):
    """Reports each turn once, as a cloud with the time of its end; marks those that cannot be used."""

    loggable = ("turns", "refused", "reason")

    cloud = Output(PointCloud, frame="frd")

    def __init__(self, device: Lidar) -> None:
        self.turns = self.refused = 0
        self.reason = ""
        self._device = device

    def start(self) -> None:
        """Opens the scanner."""
        self._timeline = StampMonitor("turn", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a turn that has not been reported yet."""
        stamped = self._device.cloud()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            reason = self._timeline.silence(now_s)
            none = PointCloud(sensor="", data=b"", is_valid=False, reason=reason)
            return [self.cloud.report(none, t_s=now_s)] if reason else []
        cloud = stamped.cloud
        self.turns += 1
        self.reason = arrival.problem or cloud_fault(cloud)
        if self.reason:
            self.refused += 1
            cloud = msgspec.structs.replace(cloud, is_valid=False, reason=self.reason)
        return [self.cloud.report(cloud, t_s=arrival.t_s)]
