"""Base of the simulated sensors: rate, latency, noise and injectable faults."""

from abc import ABC, abstractmethod
from collections import deque
from enum import StrEnum
from typing import ClassVar, Final, Generic, TypeVar

import msgspec

from gloc3.errors import Misuse
from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.noise import normals
from gloc3_sitl.sensors.readings import Reading

_EARLY_S: Final = 1e-6
"""Rounding allowed when a time is compared with a schedule."""

R = TypeVar("R", bound=Reading)


class FaultMode(StrEnum):
    """Failure modes of a sensor."""

    LOST = "lost"
    """Nothing comes any more; a range finder has no echo, a receiver reports no fix."""
    STUCK = "stuck"
    """The last values come again and again, with new times."""
    BIASED = "biased"
    """A constant is added."""
    NOISY = "noisy"
    """White noise on every axis."""
    LATE = "late"
    """Readings arrive later by the size in seconds."""
    STALE = "old"
    """So late, and stamped as if they were new."""
    SCALED = "scaled"
    """All is too much by the size, a share; of the height and of wheels alone."""


SIZED: Final = (FaultMode.BIASED, FaultMode.NOISY, FaultMode.LATE, FaultMode.STALE, FaultMode.SCALED)
"""The modes that have a size."""


class SensorFault(msgspec.Struct, frozen=True, kw_only=True):
    """A fault that is present."""

    mode: FaultMode
    """What kind it is."""
    size: float
    """Bias, noise deviation (in the sensor's `fault_unit`), lateness in seconds, or a share."""
    direction: Vector3 = (1.0, 0.0, 0.0)
    """Axes on which a bias acts; a scalar sensor uses the first."""


class SimulatedSensor(ABC, Generic[R]):
    """One simulated sensor: measures at its rate, hands over after its latency."""

    name: ClassVar[str]
    """The name by which faults are injected."""
    fault_unit: ClassVar[str]
    """Unit of the size of a fault."""
    bias_size: ClassVar[float]
    """Default bias of a fault."""
    noise_size: ClassVar[float]
    """Default noise of a fault."""
    late_s: ClassVar[float] = 0.5
    """Default lateness of a fault, s."""
    share: ClassVar[float] = 0.05
    """Default share of a fault."""
    latency_s: float = 0.0
    """Time from validity to delivery."""

    def __init__(self, seed: int, rate_hz: float) -> None:
        self.rate_hz: Final = rate_hz
        self.fault: SensorFault | None = None
        """The fault that is present, if any."""
        self.due_s = 0.0
        """When something is to be measured or delivered next."""
        self._period_s = 1.0 / rate_hz
        self._draw = normals(seed, self.name)
        self._measure_s = 0.0
        self._last: R | None = None
        self._pending: deque[tuple[float, R]] = deque()

    @abstractmethod
    def measure(self, motion: TrueMotion, t_s: float) -> R:
        """Look at the truth and add noise."""

    @abstractmethod
    def shift(self, reading: R, offset: Vector3) -> R:
        """The same reading with an error added, in the fault unit."""

    def scale(self, reading: R, factor: float) -> R:
        """The same reading times a factor."""
        del reading, factor
        raise Misuse(f"the {self.name} cannot be scaled")

    def without_signal(self, reading: R) -> R | None:
        """What is reported when the sensor is lost: nothing, unless the device itself can say so."""
        del reading
        return None

    def poll(self, motion: TrueMotion, now_s: float, out: list[Reading]) -> None:
        """Measures when due, and appends the readings that have arrived; due at most once a call."""
        running = self._pending
        if now_s >= self._measure_s - _EARLY_S:
            kept: R | None = self.measure(motion, now_s)
            if self.fault is not None and kept is not None:
                kept = self._corrupt(kept, self.fault)
            self._measure_s += self._period_s
            if self._measure_s <= now_s:
                self._measure_s = now_s + self._period_s
            if kept is not None:
                latency_s = self.latency_s if self.fault is None else self._late_s(self.fault)
                if self.fault is not None and self.fault.mode is FaultMode.STALE:
                    kept = msgspec.structs.replace(kept, t_s=now_s + latency_s)
                if latency_s > 0.0 or running:
                    running.append((now_s + latency_s, kept))
                else:
                    out.append(kept)
        while running and now_s >= running[0][0] - _EARLY_S:
            out.append(running.popleft()[1])
        self.due_s = min(self._measure_s, running[0][0]) if running else self._measure_s

    def _late_s(self, fault: SensorFault) -> float:
        return self.latency_s + (fault.size if fault.mode in (FaultMode.LATE, FaultMode.STALE) else 0.0)

    def _corrupt(self, reading: R, fault: SensorFault) -> R | None:
        match fault.mode:
            case FaultMode.LOST:
                return self.without_signal(reading)
            case FaultMode.STUCK:
                if self._last is None:
                    self._last = reading
                return msgspec.structs.replace(self._last, t_s=reading.t_s)
            case FaultMode.BIASED:
                x, y, z = fault.direction
                return self.shift(reading, (x * fault.size, y * fault.size, z * fault.size))
            case FaultMode.NOISY:
                draw, size = self._draw, fault.size
                return self.shift(reading, (draw() * size, draw() * size, draw() * size))
            case FaultMode.SCALED:
                return self.scale(reading, 1.0 + fault.size)
            case FaultMode.LATE | FaultMode.STALE:
                return reading

    def fail(self, mode: FaultMode, size: float | None = None, direction: Vector3 = (1.0, 0.0, 0.0)) -> None:
        """Activates a fault; it replaces any other."""
        if size is None:
            sizes = {
                FaultMode.BIASED: self.bias_size,
                FaultMode.NOISY: self.noise_size,
                FaultMode.LATE: self.late_s,
                FaultMode.STALE: self.late_s,
                FaultMode.SCALED: self.share,
            }
            size = sizes.get(mode, 0.0)
        self._last = None
        self.fault = SensorFault(mode=mode, size=size, direction=direction)
