"""What is known of one family of autopilots with one class of vehicle: the form of the tables of facts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from gloc3.messages.vehicle import FlightMode, VehicleClass
from gloc3_onboard.sensors.devices import Manners

Modes = Mapping[int, tuple[FlightMode, str]]
"""What a heartbeat's `custom_mode` means to us, and the autopilot's word for it."""


class Form(StrEnum):
    """In which form a vehicle is led."""

    POSITION = "position"
    """SET_POSITION_TARGET_LOCAL_NED with position, velocity as feed-forward, and yaw, as far as they are given."""
    MOVING = "moving"
    """The same, always with a velocity: a position alone begins a way anew, and a stream of such leads nowhere."""
    VELOCITY = "velocity"
    """The same with a velocity only, which leads to the position: for what steers by a heading and a speed."""
    REPOSITION = "reposition"
    """DO_REPOSITION to a place ahead, once a second: for what cannot stop."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ClassFacts:
    """One family and class."""

    vehicle: VehicleClass
    modes: Modes
    commanded: Mapping[FlightMode, int]
    """The `custom_mode` that is asked for."""
    manners: Manners
    form: Form = Form.POSITION
    tells_landed: bool = True
    """Whether EXTENDED_SYS_STATE tells where it is; else it counts as under way while it is armed."""
    timeout_s: float
    """So long after the last setpoint the autopilot acts by itself."""
    why_no_take_off: str = field(default="")
    """What is said of a take-off that such a vehicle cannot make."""


COPTERS: Final = (2, 3, 4, 13, 14, 15, 29, 35)
PLANES: Final = (1, 16, *range(19, 26))
CLASSES: Final[Mapping[int, VehicleClass]] = {
    **dict.fromkeys(COPTERS, VehicleClass.COPTER),
    **dict.fromkeys(PLANES, VehicleClass.PLANE),
    10: VehicleClass.ROVER,
    11: VehicleClass.BOAT,
    12: VehicleClass.SUB,
}
"""By MAV_TYPE."""
