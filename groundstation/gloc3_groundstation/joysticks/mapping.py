"""Mapping of a joystick: which axis moves the vehicle which way, and what the buttons do; kept in the configuration."""

import re
from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Annotated, Final

import msgspec

from gloc3_groundstation.joysticks.device import JoystickReading, StickDemand

DEAD_ZONE: Final = 0.08
"""Default dead zone of a released stick, as a share of its range."""
PRESSED_BEYOND: Final = 0.5
"""Position of an axis from which it counts as a pressed button."""
MOST_AXES, MOST_BUTTONS = 64, 256
_INPUT: Final = re.compile(r"button (\d{1,3})|axis (\d{1,2})([+-])")

Position = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
InputName = Annotated[str, msgspec.Meta(pattern=r"^(button \d{1,3}|axis \d{1,2}[+-])$")]
"""What is pressed: `button 4`, or an axis towards one of its ends, as the trigger `axis 5+`."""


class StickAxis(StrEnum):
    """An axis of the vehicle, by the field of `StickDemand`."""

    SURGE = "surge"
    SWAY = "sway"
    HEAVE = "heave"
    YAW = "yaw"


class JoystickButton(StrEnum):
    """What a button does."""

    DEAD_MAN = "dead_man"
    HOLD = "hold"
    ARM = "arm"
    DISARM = "disarm"
    MODE = "mode"
    LIGHTS_UP = "lights_up"
    LIGHTS_DOWN = "lights_down"
    GAIN_UP = "gain_up"
    GAIN_DOWN = "gain_down"


class AxisMapping(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One axis of the joystick, and its range as it was seen."""

    axis: Annotated[int, msgspec.Meta(ge=0, lt=MOST_AXES)]
    low: Position = -1.0
    """Position at the end that is the vehicle's negative direction; above `high` for an axis that counts the other way."""
    centre: Position = 0.0
    high: Position = 1.0
    dead_zone: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = DEAD_ZONE
    """Share of the range about the centre that counts as released."""

    def demand(self, position: float) -> float:
        """From -1 to 1; starts at 0 at the edge of the dead zone, without a step."""
        away = position - self.centre
        end = self.high if away * (self.high - self.low) > 0.0 else self.low
        span = abs(end - self.centre)
        if span <= 0.0:
            return 0.0
        beyond = max(0.0, min(1.0, abs(away) / span) - self.dead_zone) / (1.0 - self.dead_zone)
        return beyond if end == self.high else -beyond


class JoystickMapping(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Mapping of one make of joystick."""

    name: str = ""
    """Of the device, for people."""
    axes: Mapping[StickAxis, AxisMapping] = {}
    """An axis that is missing is never moved."""
    buttons: Mapping[JoystickButton, tuple[InputName, ...]] = {}
    """Each of the inputs does it."""

    @property
    def problem(self) -> str:
        """Why nothing can be steered by it; empty if it can."""
        if not self.buttons.get(JoystickButton.DEAD_MAN):
            return "it has no dead-man's key"
        return "" if self.axes else "no axis is mapped"

    def sticks(self, reading: JoystickReading) -> StickDemand:
        """Where the sticks are."""
        axes = reading.axes
        found = {
            name.value: row.demand(axes[row.axis]) if row.axis < len(axes) else 0.0 for name, row in self.axes.items()
        }
        return StickDemand(**found)

    def pressed(self, reading: JoystickReading) -> frozenset[JoystickButton]:
        """What is pressed."""
        return frozenset(button for button, inputs in self.buttons.items() if _is_pressed(inputs, reading))


def _is_pressed(inputs: Iterable[str], reading: JoystickReading) -> bool:
    return any(is_pressed(name, reading) for name in inputs)


def is_pressed(name: str, reading: JoystickReading) -> bool:
    """Whether an input is pressed; one that the device lacks is not."""
    found = _INPUT.fullmatch(name)
    if found is None:
        return False
    if found[1]:
        return int(found[1]) in reading.pressed
    axis = int(found[2])
    if axis >= len(reading.axes):
        return False
    return (reading.axes[axis] if found[3] == "+" else -reading.axes[axis]) > PRESSED_BEYOND
