"""SS: the ground-looking range finder."""

from collections.abc import Sequence
from typing import Annotated

from gloc3.amounts import beside
from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.sensors.devices import HeightSensor


class HeightSettings(Settings, frozen=True):
    """Settings of the height sampler."""

    min_m: Annotated[float, Bounds(0.0, 5.0)] = 0.05
    """Shortest measurable range, in metres."""
    max_m: Annotated[float, Bounds(0.1, 1000.0)] = 40.0
    """Longest range, in metres."""


class HeightSampler(SensorSampler[HeightSettings]):
    """Reports each range once; says `is_valid=False` when there is no echo."""

    loggable = ("height_m",)

    height = Output(HeightAboveGround)

    def __init__(self, device: HeightSensor) -> None:
        self.height_m = 0.0
        self._device = device
        self._last_s = float("-inf")

    def start(self) -> None:
        """Starts with data from now on."""
        self.until_stop.callback(self._device.on_height(self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a range that has not been reported yet."""
        stamped = self._device.height()
        if stamped is None or stamped.t_s <= self._last_s:
            return []
        self._last_s = stamped.t_s
        height, settings = stamped.height, self.settings
        self.height_m = height.height_m
        if height.is_valid and not settings.min_m <= height.height_m <= settings.max_m:
            limit_m = settings.min_m if height.height_m < settings.min_m else settings.max_m
            measured = beside(height.height_m, limit_m, 2)
            reason = f"{measured} m is outside {settings.min_m:g} to {settings.max_m:g} m"
            height = HeightAboveGround(height_m=height.height_m, is_valid=False, reason=reason)
        return [self.height.report(height, t_s=stamped.t_s)]
