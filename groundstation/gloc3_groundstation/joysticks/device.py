"""A joystick as it is connected, its positions at one moment, and the demand that follows from them."""

from collections.abc import Mapping
from typing import NamedTuple

import msgspec


class StickDemand(NamedTuple):
    """Demand on each axis, -1 to 1."""

    surge: float = 0.0
    """Ahead."""
    sway: float = 0.0
    """To the right."""
    heave: float = 0.0
    """Up."""
    yaw: float = 0.0
    """Clockwise."""


class JoystickDevice(msgspec.Struct, frozen=True, kw_only=True):
    """One connected joystick or gamepad."""

    key: str
    """Names its make in the configuration: SDL's GUID, or the kernel's name of it."""
    name: str
    """For people."""
    axes: int = 0
    """Number of its axes, without those of its hats."""
    controls: Mapping[str, str] = {}
    """Standard controls, as SDL's database places them: `leftx` to `a0`, `leftshoulder` to `b4`; empty where unknown."""


class JoystickReading(NamedTuple):
    """Positions of a joystick."""

    axes: tuple[float, ...] = ()
    """-1 to 1, each hat as two more axes behind the others: to the right, and down."""
    pressed: frozenset[int] = frozenset()
    """Numbers of the pressed buttons."""
