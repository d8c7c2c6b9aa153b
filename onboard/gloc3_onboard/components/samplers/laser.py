"""SS: a laser scanner."""

from collections.abc import Sequence
from typing import Annotated

import msgspec

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.perception import LaserScan
from gloc3_onboard.sensors.checks.scan_check import checked_scan
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import Laser, opened


class LaserSettings(Settings, frozen=True):
    """Settings of the laser sampler."""

    silent_s: Annotated[float, Bounds(0.05, 60.0)] = 1.0
    """Time without a scan after which the scanner counts as silent, in seconds."""


class LaserSampler(SensorSampler[LaserSettings]):
    """Reports each turn once, with the time of its last beam; marks those that cannot be used."""

    loggable = ("scans", "refused", "reason")

    laser = Output(LaserScan)

    def __init__(self, device: Laser) -> None:
        self.scans = self.refused = 0
        self.reason = ""
        self._device = device
        self._none = LaserScan(
            scanner="", angle_min_rad=0.0, angle_step_rad=0.0, range_min_m=0.0, range_max_m=0.0, ranges_m=b""
        )

    def start(self) -> None:
        """Opens the scanner."""
        self._timeline = StampMonitor("scan", self.settings.silent_s)
        self.until_stop.callback(opened(self._device, self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a turn that has not been reported yet."""
        stamped = self._device.scan()
        arrival = self._timeline.judge(stamped.t_s, now_s) if stamped is not None else None
        if stamped is None or arrival is None:
            reason = self._timeline.silence(now_s)
            none = msgspec.structs.replace(self._none, is_valid=False, reason=reason)
            return [self.laser.report(none, t_s=now_s)] if reason else []
        self.scans += 1
        if arrival.problem:
            scan = msgspec.structs.replace(stamped.scan, is_valid=False, reason=arrival.problem)
        else:
            scan = checked_scan(stamped.scan)
        self.reason = scan.reason
        self.refused += not scan.is_valid
        return [self.laser.report(scan, t_s=arrival.t_s)]
