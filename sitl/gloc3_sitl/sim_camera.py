"""The world's cameras as devices of the onboard process, in one process with the simulator."""

from collections.abc import Callable
from typing import Final

from gloc3.camera_model import CameraModel
from gloc3.vehicle import Image
from gloc3_sitl.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import Camera, Imager


class Exposure:
    """A frame with its time, as the camera sampler reads it."""

    __slots__ = ("image", "t_s")

    def __init__(self, t_s: float, image: Image) -> None:
        self.t_s = t_s
        self.image = image


class Trigger:
    """Says when a picture is taken, at a steady rate; cameras that share it look at the same instant.

    Args:
        truth: what the vehicle does now.
        now_s: the simulation's time.
        rate_hz: how often.
    """

    def __init__(self, truth: Callable[[], Truth], now_s: Callable[[], float], rate_hz: float) -> None:
        self._truth, self._now_s, self._rate_hz = truth, now_s, rate_hz
        self._slot = -1
        self._last: Truth | None = None

    def latest(self) -> Truth:
        """The truth at the latest trigger; now, if one is due."""
        slot = int(self._now_s() * self._rate_hz + 1e-6)
        if self._last is None or slot != self._slot:
            self._slot, self._last = slot, self._truth()
        return self._last


class SimCamera:
    """Takes a picture when it is asked and its trigger has gone off since the last one; none before it is opened."""

    def __init__(self, world: World, model: CameraModel, imager: Imager, trigger: Trigger, seed: int) -> None:
        self.camera: Final = Camera(world, model, imager, seed)
        """What it takes pictures with."""
        self._trigger = trigger
        self._last: Exposure | None = None
        self._is_open = False

    def open(self) -> None:
        """Begins to take frames."""
        self._is_open = True

    def close(self) -> None:
        """Ends taking frames."""
        self._is_open = False

    def on_news(self, ready: Callable[[], None]) -> Callable[[], None]:
        """It takes a picture when it is asked, and never by itself."""
        return lambda: None

    def frame(self) -> Exposure | None:
        """The latest frame; a new one if one is due."""
        if not self._is_open:
            return self._last
        truth = self._trigger.latest()
        if self._last is None or truth.t_s > self._last.t_s:
            pixels = self.camera.capture(truth).pixels
            height, width = pixels.shape
            image = Image(camera=self.camera.imager.name, width=width, height=height, data=pixels.tobytes())
            self._last = Exposure(truth.t_s, image)
        return self._last


class NoCamera:
    """A camera that is not plugged in."""

    def open(self) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing happens."""

    def on_news(self, ready: Callable[[], None]) -> Callable[[], None]:
        """There is never any."""
        return lambda: None

    def frame(self) -> None:
        """There is never a frame."""
        return
