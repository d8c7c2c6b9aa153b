"""SS: an estimator that is not ours."""

from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import EstimatorPose
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
        stamped = self._device.estimated_pose()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            if not (reason := self._timeline.silence(now_s)):
                return []
            self.quality, self.reason = 0.0, reason
            return [self.estimator_pose.report(EstimatorPose(is_valid=False, reason=reason, quality=0.0), t_s=now_s)]
        pose = stamped.pose
        if arrival.problem:
            pose = EstimatorPose(is_valid=False, reason=arrival.problem, quality=0.0)
        else:
            self.reset_counter = pose.reset_counter
        self.quality, self.reason = pose.quality, pose.reason
        return [self.estimator_pose.report(pose, t_s=arrival.t_s)]
