"""SS: a camera."""

from collections.abc import Sequence

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.checks.frame_check import FrameChecks, FrameSettings, no_frame
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Camera, Rig, opened


class CameraSampler(SensorSampler[FrameSettings]):
    """Reports each frame once, with the time at which it was exposed; marks those that cannot be used."""

    loggable = ("frames", "refused", "reason")

    image = Output(Image)

    def __init__(self, device: Camera, rig: Rig | None = None) -> None:
        self.frames = self.refused = 0
        self.reason = ""
        self._device, self._rig = device, rig
        self._camera = ""

    def start(self) -> None:
        """Opens the camera."""
        self._checks = FrameChecks(self._rig, may_repeat=self.settings.may_repeat)
        self._timeline = StampMonitor("picture", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a frame that has not been reported yet."""
        stamped = self._device.frame()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            reason = self._timeline.silence(now_s)
            return [self.image.report(no_frame(self._camera, reason), t_s=now_s)] if reason else []
        image = self._checks.marked(stamped.image, arrival.problem)
        self._camera = image.camera
        self.frames += 1
        self.reason = image.reason
        self.refused += not image.is_valid
        return [self.image.report(image, t_s=arrival.t_s)]
