"""SS: a camera."""

from collections.abc import Sequence

from gloc3.component import SensorSampler
from gloc3.ports import Inbox, Output, Result
from gloc3.settings import NoSettings
from gloc3.vehicle import Image
from gloc3_onboard.devices import Camera


class CameraSampler(SensorSampler[NoSettings]):
    """Reports each frame once, with the time at which it was exposed."""

    loggable = ("frames",)

    image = Output(Image)

    def __init__(self, device: Camera) -> None:
        self.frames = 0
        self._device = device
        self._last_s = float("-inf")

    def start(self) -> None:
        """Opens the camera."""
        self._device.open()

    def stop(self) -> None:
        """Closes the camera."""
        self._device.close()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a frame that has not been reported yet."""
        stamped = self._device.frame()
        if stamped is None or stamped.t_s <= self._last_s:
            return []
        self._last_s = stamped.t_s
        self.frames += 1
        return [self.image.report(stamped.image, t_s=stamped.t_s)]
