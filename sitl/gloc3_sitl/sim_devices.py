"""The world's cameras and laser scanner as devices of the onboard process, in one process with the simulator."""

from asyncio import AbstractEventLoop, TimerHandle
from collections.abc import Callable
from typing import Final, NamedTuple

from gloc3.perception import LaserScan
from gloc3.vehicle import Image
from gloc3_sitl.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import Camera
from gloc3_sitl.world.laser import LaserModel, LaserScanner
from gloc3_sitl.world.tracker import TrackerCamera

Ready = Callable[[], None]


class Exposure(NamedTuple):
    """A frame with its time, as a camera sampler reads it."""

    t_s: float
    image: Image


class PairExposure(NamedTuple):
    """The frames of a stereo pair, as its sampler reads them."""

    t_s: float
    left: Image
    right: Image


class Turn(NamedTuple):
    """A scan with its time, as a laser sampler reads it."""

    t_s: float
    scan: LaserScan


class Trigger:
    """Says when a device takes data, at a steady rate, while it is open.

    Args:
        loop: whose time it goes by.
        truth: what the vehicle does now.
        rate_hz: how often.
    """

    def __init__(self, loop: AbstractEventLoop, truth: Callable[[], Truth], rate_hz: float) -> None:
        self.latest: Truth | None = None
        """The truth when it last went off; None while it has not."""
        self._loop, self._truth, self._rate_hz = loop, truth, rate_hz
        self._listeners: tuple[Ready, ...] = ()
        self._timer: TimerHandle | None = None

    def start(self) -> None:
        """Goes off from now on."""
        if self._timer is None:
            self._set()

    def stop(self) -> None:
        """Goes off no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def listen(self, ready: Ready) -> Ready:
        """Has `ready` called each time; gives what ends that."""
        self._listeners = (*self._listeners, ready)

        def unwatch() -> None:
            self._listeners = tuple(other for other in self._listeners if other is not ready)

        return unwatch

    def _set(self) -> None:
        count = int(self._loop.time() * self._rate_hz + 1e-6) + 1
        self._timer = self._loop.call_at(count / self._rate_hz, self._go_off)

    def _go_off(self) -> None:
        self._set()
        self.latest = self._truth()
        for ready in self._listeners:
            ready()


class _Device:
    """What all of them have: they look at the world only while they are open, and when they are asked."""

    def __init__(self, trigger: Trigger) -> None:
        self._trigger = trigger

    def open(self) -> None:
        """Begins to take data."""
        self._trigger.start()

    def close(self) -> None:
        """Ends taking data."""
        self._trigger.stop()

    def on_news(self, ready: Ready) -> Ready:
        """Has `ready` called when there is something new; gives what ends that."""
        return self._trigger.listen(ready)


class SimCamera(_Device):
    """A camera; a picture is rendered when it is asked for."""

    def __init__(self, camera: Camera | TrackerCamera, trigger: Trigger) -> None:
        super().__init__(trigger)
        self.camera: Final = camera
        """What it takes pictures with."""
        self._last: Exposure | None = None

    def frame(self) -> Exposure | None:
        """The latest frame; None before the first."""
        truth = self._trigger.latest
        if truth is not None and (self._last is None or truth.t_s > self._last.t_s):
            self._last = Exposure(truth.t_s, _image(self.camera, truth))
        return self._last


class SimStereoCamera(_Device):
    """Two cameras that expose together."""

    def __init__(self, left: Camera, right: Camera, trigger: Trigger) -> None:
        super().__init__(trigger)
        self.left: Final = left
        self.right: Final = right
        self._last: PairExposure | None = None

    def pair(self) -> PairExposure | None:
        """The latest two frames; None before the first."""
        truth = self._trigger.latest
        if truth is not None and (self._last is None or truth.t_s > self._last.t_s):
            self._last = PairExposure(truth.t_s, _image(self.left, truth), _image(self.right, truth))
        return self._last


class SimLaser(_Device):
    """A laser scanner."""

    def __init__(self, world: World, model: LaserModel, trigger: Trigger, seed: int) -> None:
        super().__init__(trigger)
        self.scanner: Final = LaserScanner(world, model, seed)
        """What it scans with."""
        self._last: Turn | None = None

    def scan(self) -> Turn | None:
        """The latest turn; None before the first."""
        truth = self._trigger.latest
        if truth is not None and (self._last is None or truth.t_s > self._last.t_s):
            self._last = Turn(truth.t_s, self.scanner.scan(truth))
        return self._last


class NoCamera:
    """A camera that is not plugged in."""

    def open(self) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing happens."""

    def on_news(self, ready: Ready) -> Ready:
        """There is never any."""
        return lambda: None

    def frame(self) -> None:
        """There is never a frame."""
        return


def _image(camera: Camera | TrackerCamera, truth: Truth) -> Image:
    pixels = camera.capture(truth).pixels
    height, width = pixels.shape
    return Image(camera=camera.imager.name, width=width, height=height, data=pixels.tobytes())
