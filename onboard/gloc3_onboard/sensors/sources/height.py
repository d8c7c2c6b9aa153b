"""Downward range finders: those of the autopilot and of logs, and shared code for others."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.sensors.devices import StampedHeight, Unwatch, opened
from gloc3_onboard.sensors.registry import SensorKind
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records


class ReplayHeight(Replay[HeightAboveGround]):
    """A range finder from a log; it plays while subscribed."""

    _height: StampedHeight | None = None

    def play(self, t_s: float, item: HeightAboveGround) -> None:
        """Keeps a height."""
        self._height = StampedHeight(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._height = None

    def height(self) -> StampedHeight | None:
        """The latest height; None before the first."""
        self.check()
        return self._height

    def on_height(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a new height is due."""
        return opened(self, ready)


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[HeightAboveGround]]:
    del device
    return topic_records(log, part or "height", HeightAboveGround)


SENSORS: Final = (SensorKind("height", ReplayHeight, _recorded),)
