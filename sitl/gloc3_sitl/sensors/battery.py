"""The battery: a lithium-polymer pack that is discharged by the power that the vehicle draws, and its power module."""

from itertools import pairwise
from math import sqrt
from typing import Final, Protocol

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.readings import BatteryReading
from gloc3_sitl.sensors.sensor import SimulatedSensor

CELL_CURVE: Final = (
    (0.0, 3.20),
    (0.05, 3.50),
    (0.10, 3.62),
    (0.20, 3.70),
    (0.40, 3.78),
    (0.60, 3.88),
    (0.80, 4.02),
    (1.0, 4.20),
)
"""Open-circuit voltage of a lithium-polymer cell over the share of charge left (typical discharge curve at room temperature)."""
VOLTAGE_NOISE_V: Final = 0.01
"""White noise of the power module's voltage (12 bit over 60 V are 15 mV a step)."""
CURRENT_NOISE_A: Final = 0.1
"""White noise of the power module's current (12 bit over 120 A are 30 mA a step)."""


def cell_voltage_v(remaining: float) -> float:
    """Open-circuit voltage of one cell; flat beyond both ends."""
    for (left, low), (right, high) in pairwise(CELL_CURVE):
        if remaining <= right:
            return low + (high - low) * max(0.0, remaining - left) / (right - left)
    return CELL_CURVE[-1][1]


class Pack(Protocol):
    """A battery, as the model of a vehicle describes it."""

    @property
    def cells(self) -> int:
        """Number of lithium-polymer cells in series."""
        ...

    @property
    def capacity_ah(self) -> float:
        """Nominal charge."""
        ...

    @property
    def battery_resistance_ohm(self) -> float:
        """Internal resistance of the whole pack with its leads."""
        ...


class Battery(SimulatedSensor[BatteryReading]):
    """The current follows from power = current times (open-circuit voltage less current times resistance).

    An empty battery is reported as such but does not stop the rotors: what happens then is up to the failsafes.
    """

    name = "battery"
    fault_unit = "V"
    bias_size = -1.0
    noise_size = 0.5

    def __init__(self, seed: int, model: Pack, remaining: float = 1.0, rate_hz: float = 5.0) -> None:
        super().__init__(seed, rate_hz)
        self.remaining = remaining
        """Share of the charge that is truly left; may be set at any time."""
        self._model = model
        self._consumed_ah = 0.0
        self._then_s: float | None = None

    def measure(self, motion: TrueMotion, t_s: float) -> BatteryReading:
        """Discharge by the power since the last sample, and report."""
        model, power_w = self._model, motion.truth().power_w
        open_v = model.cells * cell_voltage_v(self.remaining)
        resistance = model.battery_resistance_ohm
        current_a = (open_v - sqrt(max(0.0, open_v**2 - 4.0 * resistance * power_w))) / (2.0 * resistance)
        if self._then_s is not None:
            drawn_ah = current_a * (t_s - self._then_s) / 3600.0
            self._consumed_ah += drawn_ah
            self.remaining = max(0.0, self.remaining - drawn_ah / model.capacity_ah)
        self._then_s = t_s
        return BatteryReading(
            t_s=t_s,
            voltage_v=open_v - current_a * resistance + VOLTAGE_NOISE_V * self._draw(),
            current_a=max(0.0, current_a + CURRENT_NOISE_A * self._draw()),
            consumed_ah=self._consumed_ah,
            remaining=self.remaining,
        )

    def shift(self, reading: BatteryReading, offset: Vector3) -> BatteryReading:
        """Add volts."""
        return BatteryReading(
            t_s=reading.t_s,
            voltage_v=reading.voltage_v + offset[0],
            current_a=reading.current_a,
            consumed_ah=reading.consumed_ah,
            remaining=reading.remaining,
        )
