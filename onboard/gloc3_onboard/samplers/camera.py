"""SS: a camera."""

from collections.abc import Sequence

import msgspec

from gloc3.component import SensorSampler
from gloc3.ports import Inbox, Output, Result
from gloc3.vehicle import Image
from gloc3_onboard.devices import Camera, Rig, Unwatch
from gloc3_onboard.sensing.frame_check import FrameCheck, FrameSettings
from gloc3_onboard.sensing.timeline import Timeline


class CameraSampler(SensorSampler[FrameSettings]):
    """Reports each frame once, with the time at which it was exposed; marks those that cannot be used."""

    settings_type = FrameSettings
    loggable = ("frames", "refused", "reason")

    image = Output(Image)

    def __init__(self, device: Camera, rig: Rig | None = None) -> None:
        self.frames = self.refused = 0
        self.reason = ""
        self._device, self._rig = device, rig
        self._settings = FrameSettings()
        self._check: FrameCheck | None = None
        self._timeline = Timeline("picture", self._settings.silent_s)
        self._camera = ""
        self._unwatch: Unwatch | None = None

    def initialize(self, settings: FrameSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def start(self) -> None:
        """Opens the camera."""
        self._check = None
        self._timeline = Timeline("picture", self._settings.silent_s)
        self._device.open()
        self._unwatch = self._device.on_news(self.request_cycle)

    def stop(self) -> None:
        """Closes the camera."""
        self._device.close()
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a frame that has not been reported yet."""
        stamped = self._device.frame()
        arrival = self._timeline.take(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            reason = self._timeline.silence(now_s)
            none = Image(camera=self._camera, width=0, height=0, data=b"", is_valid=False, reason=reason)
            return [self.image.report(none, t_s=now_s)] if reason else []
        image = stamped.image
        self._camera = image.camera
        if self._check is None:
            model = self._rig.model(image.camera) if self._rig is not None else None
            self._check = FrameCheck(model, may_repeat=self._settings.may_repeat)
        self.frames += 1
        self.reason = arrival.problem or self._check.problem(image)
        if self.reason:
            self.refused += 1
            image = msgspec.structs.replace(image, is_valid=False, reason=self.reason)
        return [self.image.report(image, t_s=arrival.t_s)]
