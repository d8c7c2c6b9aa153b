"""SS: a Doppler velocity log."""

from collections.abc import Sequence
from math import isfinite
from typing import Annotated

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import BottomVelocity
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Dvl, opened


class DvlSettings(Settings, frozen=True):
    """Settings of the sampler."""

    silent_s: Annotated[float, Bounds(0.1, 60.0)] = 1.5
    """Time without a velocity after which the device counts as silent, in seconds."""
    max_m_s: Annotated[float, Bounds(0.1, 30.0)] = 5.0
    """A velocity above this cannot be the vehicle's."""


class DvlSampler(SensorSampler[DvlSettings]):
    """Reports each velocity over the floor once; says when there is no bottom lock."""

    loggable = ("altitude_m", "unlocked", "reason")

    dvl = Output(BottomVelocity)

    def __init__(self, device: Dvl) -> None:
        self.altitude_m = 0.0
        self.unlocked = 0
        """Velocities without bottom lock, and those that cannot be believed."""
        self.reason = ""
        self._device = device

    def start(self) -> None:
        """Opens the device."""
        self._timeline = StampMonitor("velocity", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a velocity that has not been reported yet."""
        stamped = self._device.bottom_velocity()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            reason = self._timeline.silence(now_s)
            return [self.dvl.report(BottomVelocity(is_valid=False, reason=reason), t_s=now_s)] if reason else []
        bottom = stamped.bottom
        problem = arrival.problem or self._problem(bottom)
        if problem:
            bottom = BottomVelocity(altitude_m=bottom.altitude_m, is_valid=False, reason=problem)
        self.altitude_m, self.reason = bottom.altitude_m, bottom.reason
        self.unlocked += not bottom.is_valid
        return [self.dvl.report(bottom, t_s=arrival.t_s)]

    def _problem(self, bottom: BottomVelocity) -> str:
        if not bottom.is_valid:
            return bottom.reason or "no bottom lock"
        if not all(map(isfinite, (*bottom.velocity_frd_m_s, bottom.std_m_s))):
            return "its numbers are not finite"
        if max(map(abs, bottom.velocity_frd_m_s)) > self.settings.max_m_s:
            return f"it is faster than {self.settings.max_m_s:g} m/s"
        return ""
