"""SS: the encoders of the wheels."""

from collections.abc import Sequence
from math import isfinite
from typing import Annotated

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import WheelDistances
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Wheels


class WheelsSettings(Settings, frozen=True):
    """Settings of the sampler."""

    silent_s: Annotated[float, Bounds(0.1, 60.0)] = 1.5
    """Time without encoder data after which they count as silent, in seconds."""


class WheelsSampler(SensorSampler[WheelsSettings]):
    """Reports each reading of the encoders once; says when none comes, as from vehicles without any."""

    loggable = ("reason",)

    wheels = Output(WheelDistances)

    def __init__(self, device: Wheels) -> None:
        self.reason = ""
        self._device = device

    def start(self) -> None:
        """Starts with data from now on."""
        self._timeline = StampMonitor("wheel distance", self.settings.silent_s)
        self.until_stop.callback(self._device.on_wheels(self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a reading that has not been reported yet."""
        stamped = self._device.wheels()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            silence = self._timeline.silence(now_s)
            self.reason = silence or self.reason
            return [self.wheels.report(WheelDistances(is_valid=False, reason=silence), t_s=now_s)] if silence else []
        wheels = stamped.wheels
        self.reason = arrival.problem or (
            "" if all(map(isfinite, wheels.distances_m)) else "its numbers are not finite"
        )
        if self.reason:
            wheels = WheelDistances(is_valid=False, reason=self.reason)
        return [self.wheels.report(wheels, t_s=arrival.t_s)]
