"""Simulated probes of a world's fields: the value at the vehicle, with noise; and the lines in which they send it."""

from collections.abc import Callable
from typing import Final

from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.noise import normals
from gloc3_sitl.world.placing import Placing
from gloc3_sitl.world.world import World

RATE_HZ: Final = 5.0
"""Readings a second; slow probes, such as gas sensors, have fewer."""


class FieldProbe:
    """Measures one field at the vehicle's centre of gravity.

    Args:
        world: in which the field is.
        name: of the field.
        seed: of the noise.
    """

    def __init__(self, world: World, name: str, seed: int) -> None:
        self._field: Final = world.file.fields[name]
        self._placing: Final = Placing(world)
        self._draw: Final = normals(seed, f"field {name}")

    def measure(self, truth: Truth) -> float:
        """The value, in the field's unit."""
        value = self._field.value_at(self._placing.body(truth).position_m)
        return value + self._field.noise * self._draw()


def field_lines(world: World, seed: int) -> Callable[[Truth], bytes]:
    """Measures all fields of a world: a line `NAME VALUE UNIT` of ASCII text for each."""
    rows = [(name, FieldProbe(world, name, seed), field.unit) for name, field in world.file.fields.items()]

    def lines(truth: Truth) -> bytes:
        return "".join(f"{name} {probe.measure(truth):.6g} {unit}\n" for name, probe, unit in rows).encode("utf-8")

    return lines
