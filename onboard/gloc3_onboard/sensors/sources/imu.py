"""Inertial measuring units: those of the autopilot and of logs."""

import asyncio
import math
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from gloc3.messages.perception import ImuSample
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Imu, StampedImu
from gloc3_onboard.sensors.registry import SensorKind
from gloc3_onboard.sensors.replay import LogTime, Recorded, Replay, topic_records

KEPT: Final = 256
"""Samples of a replay: more than a second."""


class ReplayImu(Replay[ImuSample]):
    """An inertial unit of a log."""

    is_slow = False

    def __init__(
        self, loop: asyncio.AbstractEventLoop, time: LogTime, index: Callable[[], Sequence[Recorded[ImuSample]]]
    ) -> None:
        super().__init__(loop, time, index)
        self._samples: deque[StampedImu] = deque(maxlen=KEPT)

    def play(self, t_s: float, item: ImuSample) -> None:
        """Keeps a sample."""
        self._samples.append(StampedImu(t_s, item))

    def clear(self) -> None:
        """Keeps nothing."""
        self._samples.clear()

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        """What it felt after a time."""
        self.check()
        return [stamped for stamped in self._samples.copy() if stamped.t_s > after_s]


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[ImuSample]]:
    del device
    return topic_records(log, part or "imu", ImuSample)


def _poll(device: Imu) -> Sequence[Image]:
    device.samples(math.inf)
    return ()


SENSORS: Final = (SensorKind("imu", ReplayImu, _recorded, _poll),)
