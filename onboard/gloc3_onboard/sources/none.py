"""A device that is not plugged in, of any kind."""

from collections.abc import Callable, Sequence

from gloc3_onboard.sensors.devices import (
    StampedBottomVelocity,
    StampedHeight,
    StampedImage,
    StampedImu,
    StampedPair,
    StampedScan,
    Unwatch,
)


class NoSource:
    """Nothing ever comes from it."""

    def open(self) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing happens."""

    def on_news(self, ready: Callable[[], None]) -> Unwatch:
        """There is never any."""
        return lambda: None

    on_height = on_news

    def frame(self) -> StampedImage | None:
        """There is never a frame."""
        return None

    def pair(self) -> StampedPair | None:
        """There is never a pair."""
        return None

    def scan(self) -> StampedScan | None:
        """There is never a scan."""
        return None

    def height(self) -> StampedHeight | None:
        """There is never a height."""
        return None

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        """There is never a sample."""
        return ()

    def bottom_velocity(self) -> StampedBottomVelocity | None:
        """There is never a velocity."""
        return None
