"""PX4's classes of vehicles: the modes are the same for all, what differs is how each sets off and ends its way.

Sources: `px4_custom_mode.h` as listed in the MAVLink guide, and the PX4 guide, "Offboard mode", v1.16.
"""

from collections.abc import Mapping
from typing import Final

from gloc3.messages.vehicle import FlightMode, VehicleClass
from gloc3_onboard.autopilot.facts import ClassFacts, Form, Modes
from gloc3_onboard.sensors.devices import Manners

_LOSS_S: Final = 1.0
"""COM_OF_LOSS_T; setpoints must come at 2 Hz and more."""
_STREAM_S: Final = 1.0
"""The stream must have been there for at least a second before offboard mode is accepted."""

MODES: Final[Modes] = {
    1 << 16: (FlightMode.MANUAL, "MANUAL"),
    2 << 16: (FlightMode.MANUAL, "ALTCTL"),
    3 << 16: (FlightMode.MANUAL, "POSCTL"),
    4 << 16 | 1 << 24: (FlightMode.OTHER, "AUTO.READY"),
    4 << 16 | 2 << 24: (FlightMode.TAKE_OFF, "AUTO.TAKEOFF"),
    4 << 16 | 3 << 24: (FlightMode.HOLD, "AUTO.LOITER"),
    4 << 16 | 4 << 24: (FlightMode.MISSION, "AUTO.MISSION"),
    4 << 16 | 5 << 24: (FlightMode.RETURN, "AUTO.RTL"),
    4 << 16 | 6 << 24: (FlightMode.LAND, "AUTO.LAND"),
    4 << 16 | 8 << 24: (FlightMode.OTHER, "AUTO.FOLLOW"),
    4 << 16 | 9 << 24: (FlightMode.OTHER, "AUTO.PRECLAND"),
    5 << 16: (FlightMode.MANUAL, "ACRO"),
    6 << 16: (FlightMode.GUIDED, "OFFBOARD"),
    7 << 16: (FlightMode.MANUAL, "STABILIZED"),
    8 << 16: (FlightMode.MANUAL, "RATTITUDE"),
}
_COMMANDED: Final = {
    FlightMode.HOLD: 4 << 16 | 3 << 24,
    FlightMode.MISSION: 4 << 16 | 4 << 24,
    FlightMode.RETURN: 4 << 16 | 5 << 24,
    FlightMode.GUIDED: 6 << 16,
}

COPTER: Final = ClassFacts(
    vehicle=VehicleClass.COPTER,
    modes=MODES,
    commanded=_COMMANDED,
    manners=Manners(stream_before_guided_s=_STREAM_S),
    timeout_s=_LOSS_S,
)

ROVER: Final = ClassFacts(
    vehicle=VehicleClass.ROVER,
    modes=MODES,
    commanded={**_COMMANDED, FlightMode.LAND: _COMMANDED[FlightMode.HOLD]},
    manners=Manners(
        vehicle=VehicleClass.ROVER,
        stream_before_guided_s=_STREAM_S,
        climbs=False,
        land_mode=FlightMode.HOLD,
        disarms_itself=False,
        at_rest_s=1.0,
    ),
    form=Form.VELOCITY,
    tells_landed=False,
    timeout_s=_LOSS_S,
    why_no_take_off="a rover does not take off; its missions begin with drive_off",
)

PLANE: Final = ClassFacts(
    vehicle=VehicleClass.PLANE,
    modes=MODES,
    commanded=_COMMANDED,
    manners=Manners(vehicle=VehicleClass.PLANE, stream_before_guided_s=_STREAM_S),
    timeout_s=_LOSS_S,
)
"""In offboard mode it flies to the position and circles there."""

CLASSES: Final[Mapping[VehicleClass, ClassFacts]] = {facts.vehicle: facts for facts in (COPTER, ROVER, PLANE)}
