"""SS: a depth camera."""

from collections.abc import Sequence

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.messages.perception import DepthImage
from gloc3_onboard.sensors.checks.depth_check import DepthCheck, no_depth
from gloc3_onboard.sensors.checks.frame_check import FrameSettings
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import DepthCamera, Rig, opened


class DepthCameraSampler(SensorSampler[FrameSettings]):
    """Reports each depth picture once, with the time at which it was exposed; marks those that cannot be used."""

    loggable = ("frames", "refused", "reason")

    depth = Output(DepthImage)

    def __init__(self, device: DepthCamera, rig: Rig | None = None) -> None:
        self.frames = self.refused = 0
        self.reason = ""
        self._device, self._rig = device, rig
        self._camera = ""

    def start(self) -> None:
        """Opens the camera."""
        self._check = DepthCheck(self._rig, may_repeat=self.settings.may_repeat)
        self._timeline = StampMonitor("picture", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a picture that has not been reported yet."""
        stamped = self._device.depth()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            reason = self._timeline.silence(now_s)
            return [self.depth.report(no_depth(self._camera, reason), t_s=now_s)] if reason else []
        depth = self._check.marked(stamped.depth, arrival.problem)
        self._camera = depth.camera
        self.frames += 1
        self.reason = depth.reason
        self.refused += not depth.is_valid
        return [self.depth.report(depth, t_s=arrival.t_s)]
