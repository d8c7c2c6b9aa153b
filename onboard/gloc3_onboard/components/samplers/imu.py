"""SS: an inertial measuring unit."""

import math
from collections.abc import Sequence
from typing import Annotated, Final

import msgspec

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import ImuSample
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Imu, opened

MOST_RATE_RAD_S: Final = 70.0
"""4000 degrees a second."""
MOST_FORCE_M_S2: Final = 320.0
"""32 g."""
STUCK_AFTER: Final = 50
"""Number of equal consecutive samples that counts as stuck; noise makes two equal ones rare."""


class ImuSettings(Settings, frozen=True):
    """Settings of the IMU sampler."""

    silent_s: Annotated[float, Bounds(0.02, 60.0)] = 0.5
    """Time without a sample after which the unit counts as silent, in seconds."""
    may_repeat: bool = False
    """Whether samples may be equal for ever; else the unit counts as stuck."""


class ImuSampler(SensorSampler[ImuSettings]):
    """Reports every sample with its own time; marks unusable ones."""

    loggable = ("samples", "refused", "reason")

    imu = Output(ImuSample)

    def __init__(self, device: Imu) -> None:
        self.samples = self.refused = 0
        self.reason = ""
        self._device = device
        self._restart()

    def _restart(self) -> None:
        self._timeline = StampMonitor("sample", self.settings.silent_s)
        self._check = ImuCheck(may_repeat=self.settings.may_repeat)
        self._last_s = float("-inf")

    def start(self) -> None:
        """Opens the unit."""
        self._restart()
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports the samples that have not been reported yet."""
        found = self._device.samples(self._last_s)
        results: list[Result] = []
        for t_s, sample in found:
            self._last_s = t_s
            arrival = self._timeline.judge(t_s, now_s)
            if arrival is not None:
                self.samples += 1
                self.reason = arrival.problem or self._check.problem(sample)
                if self.reason:
                    self.refused += 1
                    sample = msgspec.structs.replace(sample, is_valid=False, reason=self.reason)
                results.append(self.imu.report(sample, t_s=arrival.t_s))
        reason = "" if found else self._timeline.silence(now_s)
        if reason:
            none = ImuSample(
                rate_frd_rad_s=(0.0, 0.0, 0.0), specific_force_frd_m_s2=(0.0, 0.0, 0.0), is_valid=False, reason=reason
            )
            results.append(self.imu.report(none, t_s=now_s))
        return results


class ImuCheck:
    """Checks the samples of one unit.

    Args:
        may_repeat: whether samples may be equal for ever, as those of a unit without noise at rest are.
    """

    def __init__(self, *, may_repeat: bool = False) -> None:
        self._may_repeat = may_repeat
        self._last: ImuSample | None = None
        self._equal = 0

    def problem(self, sample: ImuSample) -> str:
        """Why the sample cannot be used; empty if it can."""
        if not sample.is_valid:
            return sample.reason or "the unit reports it"
        rate = math.hypot(*sample.rate_frd_rad_s)
        force = math.hypot(*sample.specific_force_frd_m_s2)
        if not math.isfinite(rate + force):
            return "it is not a number"
        if rate > MOST_RATE_RAD_S:
            return f"{rate:.0f} rad/s is out of range"
        if force > MOST_FORCE_M_S2:
            return f"{force:.0f} m/s2 is out of range"
        self._equal = self._equal + 1 if sample == self._last else 0
        self._last = sample
        if self._equal >= STUCK_AFTER and not self._may_repeat:
            return f"the same for {self._equal} samples: the unit is stuck"
        return ""
