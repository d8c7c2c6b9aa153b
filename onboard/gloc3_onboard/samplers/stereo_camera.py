"""SS: a stereo pair."""

from collections.abc import Sequence

import msgspec

from gloc3.component import SensorSampler
from gloc3.ports import Inbox, Output, Result
from gloc3.vehicle import Image
from gloc3_onboard.devices import Rig, StereoCamera, Unwatch
from gloc3_onboard.sensing.frame_check import FrameCheck, FrameSettings
from gloc3_onboard.sensing.timeline import Timeline


class StereoCameraSampler(SensorSampler[FrameSettings]):
    """Reports both frames of an exposure, once, with one time; marks those that cannot be used."""

    settings_type = FrameSettings
    loggable = ("pairs", "refused", "reason")

    left = Output(Image)
    right = Output(Image)

    def __init__(self, device: StereoCamera, rig: Rig | None = None) -> None:
        self.pairs = self.refused = 0
        self.reason = ""
        self._device, self._rig = device, rig
        self._settings = FrameSettings()
        self._checks: dict[str, FrameCheck] = {}
        self._timeline = Timeline("pair of pictures", self._settings.silent_s)
        self._cameras = ("", "")
        self._unwatch: Unwatch | None = None

    def initialize(self, settings: FrameSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def start(self) -> None:
        """Opens the cameras."""
        self._checks.clear()
        self._timeline = Timeline("pair of pictures", self._settings.silent_s)
        self._device.open()
        self._unwatch = self._device.on_news(self.request_cycle)

    def stop(self) -> None:
        """Closes the cameras."""
        self._device.close()
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a pair that has not been reported yet."""
        pair = self._device.pair()
        arrival = self._timeline.take(pair.t_s, now_s) if pair is not None else None
        if pair is None or arrival is None:
            reason = self._timeline.silence(now_s)
            if not reason:
                return []
            left, right = (
                Image(camera=camera, width=0, height=0, data=b"", is_valid=False, reason=reason)
                for camera in self._cameras
            )
            return [self.left.report(left, t_s=now_s), self.right.report(right, t_s=now_s)]
        self._cameras = (pair.left.camera, pair.right.camera)
        left, right = (self._checked(image, arrival.problem) for image in (pair.left, pair.right))
        self.pairs += 1
        self.reason = left.reason or right.reason
        self.refused += bool(self.reason)
        return [self.left.report(left, t_s=arrival.t_s), self.right.report(right, t_s=arrival.t_s)]

    def _checked(self, image: Image, problem: str) -> Image:
        if image.camera not in self._checks:
            model = self._rig.model(image.camera) if self._rig is not None else None
            self._checks[image.camera] = FrameCheck(model, may_repeat=self._settings.may_repeat)
        problem = problem or self._checks[image.camera].problem(image)
        return msgspec.structs.replace(image, is_valid=False, reason=problem) if problem else image
