"""3D scanners: mounting, and replay from logs."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from gloc3.messages.frames import Vector3
from gloc3.messages.perception import PointCloud
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Lidar, StampedCloud
from gloc3_onboard.sensors.registry import SensorKind
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records
from gloc3_onboard.sensors.source_url import Number, Options, SourceUrl

LIDAR: Final = "lidar"
_LENGTH: Final = Number(-20.0, 20.0)
_ANGLE: Final = Number(-360.0, 360.0)
PLACE: Final[Options] = {
    "forward_m": _LENGTH,
    "right_m": _LENGTH,
    "down_m": _LENGTH,
    "roll_deg": _ANGLE,
    "pitch_deg": _ANGLE,
    "yaw_deg": _ANGLE,
}
"""The options of a scanner's mounting: its place in the body, and how it is turned, about its own down axis first."""


class LidarMount(NamedTuple):
    """Place of a scanner on the vehicle."""

    position_frd_m: Vector3
    frd_from_scanner: npt.NDArray[np.float64]
    """Rotation from the scanner's axes (forward, right, down), (3, 3)."""

    @classmethod
    def of(cls, url: SourceUrl) -> "LidarMount":
        """The mounting that a source states; yaw, pitch and roll as of a vehicle."""
        forward_m, right_m, down_m = (url.number(name, 0.0) for name in ("forward_m", "right_m", "down_m"))
        roll, pitch, yaw = (math.radians(url.number(name, 0.0)) for name in ("roll_deg", "pitch_deg", "yaw_deg"))
        (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in (roll, pitch, yaw))
        turn = np.array(((cy, -sy, 0.0), (sy, cy, 0.0), (0.0, 0.0, 1.0)))
        turn = turn @ np.array(((cp, 0.0, sp), (0.0, 1.0, 0.0), (-sp, 0.0, cp)))
        turn = turn @ np.array(((1.0, 0.0, 0.0), (0.0, cr, -sr), (0.0, sr, cr)))
        return cls((forward_m, right_m, down_m), turn)

    def placed(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Points of the scanner, (n, 3), on the axes of the body."""
        placed: npt.NDArray[np.float64] = points @ self.frd_from_scanner.T + np.array(self.position_frd_m)
        return placed


class ReplayLidar(Replay[PointCloud]):
    """A 3D scanner of a log."""

    _cloud: StampedCloud | None = None

    def play(self, t_s: float, item: PointCloud) -> None:
        """Keeps a turn."""
        self._cloud = StampedCloud(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._cloud = None

    def cloud(self) -> StampedCloud | None:
        """The latest turn; None before the first."""
        self.check()
        return self._cloud


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[PointCloud]]:
    return topic_records(log, part or f"cloud/{device}", PointCloud)


def _poll(device: Lidar) -> Sequence[Image]:
    device.cloud()
    return ()


SENSORS: Final = (SensorKind(LIDAR, ReplayLidar, _recorded, _poll),)
