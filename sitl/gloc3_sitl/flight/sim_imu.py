"""The IMU of the onboard process, with faults that do not affect the autopilot's own IMU."""

from asyncio import AbstractEventLoop
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, Protocol

import msgspec
import numpy as np

from gloc3.messages.frames import Vector3
from gloc3.messages.perception import ImuSample
from gloc3_sitl.faults.device_faults import DeviceFault, is_silent, is_stuck, late_by_s, size_of

IMU: Final = ("lost", "stuck", "late", "old", "scaled", "step", "garbage")
"""Faults of an inertial unit; a step is a bias on each axis, in m/s², and a tenth of it in rad/s."""
_MOST: Final = (20.0, 60.0)
"""Limits of garbage: rad/s and m/s²."""
_KEPT: Final = 256


class MeasuredForces(NamedTuple):
    """A sample with its time of validity, as a sampler reads it."""

    t_s: float
    sample: ImuSample


class InertialUnit(Protocol):
    """An inertial unit."""

    def open(self) -> None:
        """Begins."""

    def close(self) -> None:
        """Ends."""

    def on_new_data(self, ready: Callable[[], None]) -> Callable[[], None]:
        """Has `ready` called when a sample has come."""

    def samples(self, after_s: float) -> Sequence[tuple[float, ImuSample]]:
        """What it felt after a time, oldest first."""


class SimImu:
    """An inertial unit with injectable faults.

    Args:
        loop: event loop whose clock is used.
        seed: seed of the garbage.
    """

    def __init__(self, loop: AbstractEventLoop, seed: int) -> None:
        self.fault: DeviceFault | None = None
        """What is wrong with it."""
        self._loop = loop
        self._random: Final = np.random.default_rng(seed)
        self._pending: deque[tuple[float, MeasuredForces]] = deque()
        self._arrived: deque[MeasuredForces] = deque(maxlen=_KEPT)

    def wire(self, unit: InertialUnit) -> None:
        """Connects the fault-free unit to read from."""
        self._unit = unit
        self._read_s = float("-inf")
        self._pending.clear()
        self._arrived.clear()

    def open(self) -> None:
        """Begins."""
        self._unit.open()

    def close(self) -> None:
        """Ends."""
        self._unit.close()

    def on_new_data(self, ready: Callable[[], None]) -> Callable[[], None]:
        """Has `ready` called when a sample has come."""
        return self._unit.on_new_data(lambda: None if is_silent(self.fault) else ready())

    def samples(self, after_s: float) -> Sequence[MeasuredForces]:
        """Samples measured after a time that have arrived, oldest first."""
        now_s, fault = self._loop.time(), self.fault
        for t_s, sample in self._unit.samples(self._read_s):
            self._read_s = t_s
            if not is_silent(fault):
                self._pending.append((t_s + late_by_s(fault), MeasuredForces(t_s, sample)))
        while self._pending and self._pending[0][0] <= now_s:
            due_s, measured = self._pending.popleft()
            t_s = due_s if fault is not None and fault.word == "old" else measured.t_s
            self._arrived.append(MeasuredForces(t_s, self._corrupted(measured.sample, fault)))
        return [measured for measured in self._arrived if measured.t_s > after_s]

    def _corrupted(self, sample: ImuSample, fault: DeviceFault | None) -> ImuSample:
        if fault is None:
            return sample
        rate, force = sample.rate_frd_rad_s, sample.specific_force_frd_m_s2
        if is_stuck(fault) and self._arrived:
            return self._arrived[-1].sample
        match fault:
            case DeviceFault("scaled"):
                factor = 1.0 + size_of(fault)
                rate, force = _shifted(rate, factor, 0.0), _shifted(force, factor, 0.0)
            case DeviceFault("step"):
                rate, force = _shifted(rate, 1.0, 0.1 * size_of(fault)), _shifted(force, 1.0, size_of(fault))
            case DeviceFault("garbage"):
                rate, force = self._any(_MOST[0]), self._any(_MOST[1])
        return msgspec.structs.replace(sample, rate_frd_rad_s=rate, specific_force_frd_m_s2=force)

    def _any(self, most: float) -> Vector3:
        x, y, z = self._random.uniform(-most, most, 3).tolist()
        return (x, y, z)


def _shifted(values: Vector3, factor: float, by: float) -> Vector3:
    x, y, z = values
    return (x * factor + by, y * factor + by, z * factor + by)
