"""The world's cameras, scanners and probes as devices of the onboard process, in one process with the simulator."""

from asyncio import AbstractEventLoop, TimerHandle
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from gloc3.messages.vehicle import Image
from gloc3_sitl.faults.device_faults import (
    Bottom,
    DeviceFault,
    Estimated,
    FaultyCloud,
    FaultyDepth,
    FaultyFrame,
    FaultyReading,
    FaultyScan,
    PairExposure,
    corrupted,
    is_silent,
    is_stuck,
    late_by_s,
    seen_from,
)
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.dvl import DvlModel
from gloc3_sitl.sensors.estimator import EstimatorModel
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.depth_camera import SimulatedDepthCamera
from gloc3_sitl.world.field_probe import FieldProbe
from gloc3_sitl.world.laser import LaserModel, LaserScanner, LidarModel, LidarScanner
from gloc3_sitl.world.tracker import TrackerCamera

Ready = Callable[[], None]
T = TypeVar("T", FaultyFrame, PairExposure, FaultyDepth, FaultyScan, FaultyCloud, Bottom, FaultyReading, Estimated)

_KEPT: Final = 64
"""How many instants a trigger remembers, for devices that are late."""


class CaptureTrigger:
    """Triggers a device at a steady rate while it is open.

    Args:
        loop: event loop whose clock is used.
        truth: returns the vehicle's current state.
        rate_hz: trigger rate.
    """

    def __init__(self, loop: AbstractEventLoop, truth: Callable[[], Truth], rate_hz: float) -> None:
        self._truths: deque[tuple[float, Truth]] = deque(maxlen=_KEPT)
        self._loop, self._truth, self._rate_hz = loop, truth, rate_hz
        self._listeners: tuple[Ready, ...] = ()
        self._timer: TimerHandle | None = None

    def start(self) -> None:
        """Starts triggering."""
        if self._timer is None:
            self._set()

    def stop(self) -> None:
        """Stops triggering."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def truth(self, late_s: float = 0.0) -> Truth | None:
        """The truth at the latest trigger that is at least `late_s` ago; None if there is none."""
        until_s = self._loop.time() - late_s + 1e-6
        return next((truth for t_s, truth in reversed(self._truths) if t_s <= until_s), None)

    def listen(self, ready: Ready) -> Ready:
        """Calls `ready` at each trigger; returns a function that ends this."""
        self._listeners = (*self._listeners, ready)

        def unwatch() -> None:
            self._listeners = tuple(other for other in self._listeners if other is not ready)

        return unwatch

    def _set(self) -> None:
        count = int(self._loop.time() * self._rate_hz + 1e-6) + 1
        self._timer = self._loop.call_at(count / self._rate_hz, self._go_off)

    def _go_off(self) -> None:
        self._set()
        self._truths.append((self._loop.time(), self._truth()))
        for ready in self._listeners:
            ready()


class _Device(Generic[T]):
    """Base of simulated devices: they observe the world only while open, and when read."""

    def __init__(self, trigger: CaptureTrigger) -> None:
        self.fault: DeviceFault | None = None
        """What is wrong with it."""
        self._begun: tuple[DeviceFault, Truth] | None = None
        """The current fault and the vehicle's state at its start."""
        self._trigger = trigger
        self._last: T | None = None

    def open(self) -> None:
        """Begins to take data."""
        self._trigger.start()

    def close(self) -> None:
        """Ends taking data."""
        self._trigger.stop()

    def on_new_data(self, ready: Ready) -> Ready:
        """Calls `ready` when new data exist; returns a function that ends this."""
        return self._trigger.listen(lambda: None if is_silent(self.fault) else ready())

    def _capture(self, truth: Truth) -> T:
        raise NotImplementedError

    def _newest(self) -> T | None:
        """Current output: new once a trigger, modified by the fault."""
        fault = self.fault
        truth = self._trigger.truth(late_by_s(fault))
        stamp = truth if fault is None or fault.word != "old" else self._trigger.truth()
        if truth is None or stamp is None or is_silent(fault):
            return self._last
        if self._last is not None and stamp.t_s <= self._last.t_s:
            return self._last
        if fault is not None and (self._begun is None or self._begun[0] is not fault):
            self._begun = (fault, truth)
        if self._last is not None and is_stuck(fault):
            self._last = self._last._replace(t_s=truth.t_s)
        else:
            begin = self._begun[1] if self._begun is not None else truth
            self._last = corrupted(self._capture(self._seen_from(truth, fault, begin)), fault)._replace(t_s=stamp.t_s)
        return self._last

    def _seen_from(self, truth: Truth, fault: DeviceFault | None, begin: Truth) -> Truth:
        return seen_from(truth, fault, begin)


class SimCamera(_Device[FaultyFrame]):
    """A camera; pictures are rendered when read."""

    def __init__(self, camera: SimulatedCamera | TrackerCamera, trigger: CaptureTrigger) -> None:
        super().__init__(trigger)
        self.camera: Final = camera
        """What it takes pictures with."""

    def frame(self) -> FaultyFrame | None:
        """The latest frame; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> FaultyFrame:
        return FaultyFrame(truth.t_s, _image(self.camera, truth))


class SimStereoCamera(_Device[PairExposure]):
    """Two cameras that expose together."""

    def __init__(self, left: SimulatedCamera, right: SimulatedCamera, trigger: CaptureTrigger) -> None:
        super().__init__(trigger)
        self.left: Final = left
        self.right: Final = right

    def pair(self) -> PairExposure | None:
        """The latest two frames; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> PairExposure:
        return PairExposure(truth.t_s, _image(self.left, truth), _image(self.right, truth))


class SimDepthCamera(_Device[FaultyDepth]):
    """A depth camera."""

    def __init__(self, camera: SimulatedDepthCamera, trigger: CaptureTrigger) -> None:
        super().__init__(trigger)
        self.camera: Final = camera
        """What it measures with."""

    def depth(self) -> FaultyDepth | None:
        """The latest frame; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> FaultyDepth:
        return FaultyDepth(truth.t_s, self.camera.capture(truth))

    def _seen_from(self, truth: Truth, fault: DeviceFault | None, begin: Truth) -> Truth:
        """Depths of a scaled camera are too long; its position is right."""
        return truth if fault is not None and fault.word == "scaled" else super()._seen_from(truth, fault, begin)


class SimLaser(_Device[FaultyScan]):
    """A laser scanner."""

    def __init__(self, world: World, model: LaserModel, trigger: CaptureTrigger, seed: int) -> None:
        super().__init__(trigger)
        self.scanner: Final = LaserScanner(world, model, seed)
        """What it scans with."""

    def scan(self) -> FaultyScan | None:
        """The latest turn; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> FaultyScan:
        return FaultyScan(truth.t_s, self.scanner.scan(truth))

    def _seen_from(self, truth: Truth, fault: DeviceFault | None, begin: Truth) -> Truth:
        """Ranges of a scaled scanner are too long; its position is right."""
        return truth if fault is not None and fault.word == "scaled" else super()._seen_from(truth, fault, begin)


class SimLidar(_Device[FaultyCloud]):
    """A 3D scanner."""

    def __init__(self, world: World, model: LidarModel, trigger: CaptureTrigger, seed: int) -> None:
        super().__init__(trigger)
        self.scanner: Final = LidarScanner(world, model, seed)
        """What it scans with."""

    def cloud(self) -> FaultyCloud | None:
        """The latest turn; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> FaultyCloud:
        return FaultyCloud(truth.t_s, self.scanner.turn(truth))

    def _seen_from(self, truth: Truth, fault: DeviceFault | None, begin: Truth) -> Truth:
        """Ranges of a scaled scanner are too long; its position is right."""
        return truth if fault is not None and fault.word == "scaled" else super()._seen_from(truth, fault, begin)


class SimDvl(_Device[Bottom]):
    """A Doppler velocity log."""

    def __init__(self, trigger: CaptureTrigger, seed: int) -> None:
        super().__init__(trigger)
        self.model: Final = DvlModel(seed)
        """What it measures with."""

    def bottom_velocity(self) -> Bottom | None:
        """The latest velocity over the floor; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> Bottom:
        return Bottom(truth.t_s, self.model.measure(truth))


class SimProbe(_Device[FaultyReading]):
    """A probe of a field of the world."""

    def __init__(self, world: World, field: str, trigger: CaptureTrigger, seed: int) -> None:
        super().__init__(trigger)
        self._probe = FieldProbe(world, field, seed)

    def reading(self) -> FaultyReading | None:
        """The latest reading; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> FaultyReading:
        return FaultyReading(truth.t_s, self._probe.measure(truth))

    def _seen_from(self, truth: Truth, fault: DeviceFault | None, begin: Truth) -> Truth:
        """Readings of a scaled probe are too high; its position is right."""
        return truth if fault is not None and fault.word == "scaled" else super()._seen_from(truth, fault, begin)


class SimEstimator(_Device[Estimated]):
    """An estimator of another maker."""

    def __init__(self, trigger: CaptureTrigger, seed: int) -> None:
        super().__init__(trigger)
        self.model: Final = EstimatorModel(seed)
        """What it reckons with."""

    def estimated_pose(self) -> Estimated | None:
        """The latest pose; None before the first."""
        return self._newest()

    def _capture(self, truth: Truth) -> Estimated:
        return Estimated(truth.t_s, self.model.measure(truth))


class NoDevice:
    """A camera or a probe that is not plugged in."""

    def open(self) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing happens."""

    def on_new_data(self, ready: Ready) -> Ready:
        """There is never any."""
        return lambda: None

    def frame(self) -> None:
        """There is never a frame."""
        return

    def reading(self) -> None:
        """There is never a reading."""
        return


def _image(camera: SimulatedCamera | TrackerCamera, truth: Truth) -> Image:
    photo = camera.capture(truth)
    height, width = photo.pixels.shape
    data, bgr = photo.pixels.tobytes(), b"" if photo.bgr is None else photo.bgr.tobytes()
    if isinstance(camera, SimulatedCamera):
        camera.keep(data, truth)
    return Image(camera=camera.imager.name, width=width, height=height, data=data, bgr=bgr)
