"""SS: an estimator that is not ours."""

from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import EstimatorPose
from gloc3_onboard.sensors.checks.estimator_check import next_pose
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import ExternalEstimator, opened


class EstimatorSettings(Settings, frozen=True):
    """Settings of the sampler."""

    silent_s: Annotated[float, Bounds(0.05, 60.0)] = 0.5
    """Time without a pose after which the estimator counts as silent, in seconds."""


class EstimatorSampler(SensorSampler[EstimatorSettings]):
    """Reports each pose once, in the estimator's own axes; says when it is silent or has lost its way."""

    loggable = ("reset_counter", "quality", "reason")

    estimator_pose = Output(EstimatorPose)

    def __init__(self, device: ExternalEstimator) -> None:
        self.reset_counter = 0
        self.quality = 0.0
        self.reason = ""
        self._device = device

    def start(self) -> None:
        """Opens the device."""
        self._timeline = StampMonitor("pose", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a pose that has not been reported yet."""
        stamped = next_pose(self._device, self._timeline, now_s)
        if stamped is None:
            return []
        pose = stamped.pose
        if pose.is_valid:
            self.reset_counter = pose.reset_counter
        self.quality, self.reason = pose.quality, pose.reason
        return [self.estimator_pose.report(pose, t_s=stamped.t_s)]
