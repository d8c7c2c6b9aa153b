"""Range scanners: shared code, mounting, and replay from logs."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from gloc3.messages.perception import LaserScan
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Laser, StampedScan
from gloc3_onboard.sensors.registry import SensorKind
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records
from gloc3_onboard.sensors.source_url import YAW, Number, Options, SourceUrl

MOUNT: Final[Options] = {**YAW, "is_flipped": Number(0, 1, True), "time_shift_s": Number(-1.0, 1.0)}
"""The options of a scanner's mounting, and what is added to its times."""


def mounted_scan(t_s: float, scan: LaserScan, url: SourceUrl) -> StampedScan:
    """The scan with x forward, for a mount turned left by `yaw_deg` or upside down (`is_flipped=1`), at its shifted time."""
    yaw_rad = math.radians(url.number("yaw_deg", 0.0))
    if url.number("is_flipped", 0.0):
        import numpy as np

        ranges = np.frombuffer(scan.ranges_m, "<f4")
        last_rad = scan.angle_min_rad + (len(ranges) - 1) * scan.angle_step_rad
        scan = msgspec.structs.replace(scan, angle_min_rad=-last_rad, ranges_m=ranges[::-1].tobytes())
    scan = msgspec.structs.replace(scan, angle_min_rad=scan.angle_min_rad + yaw_rad) if yaw_rad else scan
    return StampedScan(t_s + url.number("time_shift_s", 0.0), scan)


class ReplayLaser(Replay[LaserScan]):
    """A range scanner of a log."""

    _scan: StampedScan | None = None

    def play(self, t_s: float, item: LaserScan) -> None:
        """Keeps a turn."""
        self._scan = StampedScan(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._scan = None

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first."""
        self.check()
        return self._scan


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[LaserScan]]:
    del device
    return topic_records(log, part or "laser", LaserScan)


def _poll(device: Laser) -> Sequence[Image]:
    device.scan()
    return ()


SENSORS: Final = (SensorKind("laser", ReplayLaser, _recorded, _poll),)
