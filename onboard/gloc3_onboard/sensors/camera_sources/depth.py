"""Depth cameras: names, and replay from logs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gloc3.messages.perception import DepthImage
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import DepthCamera, StampedDepth
from gloc3_onboard.sensors.registry import SensorKind
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records

DEPTH: Final = "depth_camera"


class ReplayDepthCamera(Replay[DepthImage]):
    """A depth camera of a log."""

    _depth: StampedDepth | None = None

    def play(self, t_s: float, item: DepthImage) -> None:
        """Keeps a frame."""
        self._depth = StampedDepth(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._depth = None

    def depth(self) -> StampedDepth | None:
        """The latest frame; None before the first."""
        self.check()
        return self._depth


def depth_name(device: str) -> str:
    """What the pictures of a depth camera are called: `rear_depth_camera` takes those of *rear_depth*."""
    return device.removesuffix("_camera")


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[DepthImage]]:
    return topic_records(log, part or f"depth/{depth_name(device)}", DepthImage)


def _poll(device: DepthCamera) -> Sequence[Image]:
    device.depth()
    return ()


SENSORS: Final = (SensorKind(DEPTH, ReplayDepthCamera, _recorded, _poll, lambda device: (depth_name(device),)),)
