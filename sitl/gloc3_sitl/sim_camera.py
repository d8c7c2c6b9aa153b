"""The world's camera as a device of the onboard process, in one process with the simulator."""

from collections.abc import Callable

from gloc3.vehicle import Image
from gloc3_sitl.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import GROUND_CAMERA, Camera


class Exposure:
    """A frame with its time, as the camera sampler reads it."""

    __slots__ = ("image", "t_s")

    def __init__(self, t_s: float, image: Image) -> None:
        self.t_s = t_s
        self.image = image


class SimCamera:
    """Takes pictures at the camera's rate, when it is asked."""

    def __init__(self, world: World, truth: Callable[[], Truth], now_s: Callable[[], float], seed: int) -> None:
        self._camera = Camera(world, GROUND_CAMERA, seed)
        self._truth, self._now_s = truth, now_s
        self._period_s = 1.0 / GROUND_CAMERA.rate_hz
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
        now_s = self._now_s()
        if self._is_open and (self._last is None or now_s - self._last.t_s >= self._period_s - 1e-6):
            photo = self._camera.capture(self._truth())
            height, width = photo.pixels.shape
            image = Image(camera="ground", width=width, height=height, data=photo.pixels.tobytes())
            self._last = Exposure(photo.t_s, image)
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
