"""SS: a stereo pair."""

from collections.abc import Sequence

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.checks.frame_check import FrameChecks, FrameSettings, no_frame
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Rig, StereoCamera, opened


class StereoCameraSampler(SensorSampler[FrameSettings]):
    """Reports both frames of an exposure, once, with one time; marks those that cannot be used."""

    loggable = ("pairs", "refused", "reason")

    left = Output(Image)
    right = Output(Image)

    def __init__(self, device: StereoCamera, rig: Rig | None = None) -> None:
        self.pairs = self.refused = 0
        self.reason = ""
        self._device, self._rig = device, rig
        self._cameras = ("", "")

    def start(self) -> None:
        """Opens the cameras."""
        self._checks = FrameChecks(self._rig, may_repeat=self.settings.may_repeat)
        self._timeline = StampMonitor("pair of pictures", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a pair that has not been reported yet."""
        pair = self._device.pair()
        arrival = self._timeline.judge(pair.t_s, now_s) if pair is not None else None
        if pair is None or arrival is None:
            reason = self._timeline.silence(now_s)
            if not reason:
                return []
            left, right = (no_frame(camera, reason) for camera in self._cameras)
            return [self.left.report(left, t_s=now_s), self.right.report(right, t_s=now_s)]
        self._cameras = (pair.left.camera, pair.right.camera)
        left, right = (self._checks.marked(image, arrival.problem) for image in (pair.left, pair.right))
        self.pairs += 1
        self.reason = left.reason or right.reason
        self.refused += bool(self.reason)
        return [self.left.report(left, t_s=arrival.t_s), self.right.report(right, t_s=arrival.t_s)]
