"""ArduPilot's style for planes: the modes and refusals of Plane, and its Guided mode."""

from dataclasses import replace
from typing import Final

from gloc3_sitl.autopilot.behaviours.touching_down import AutoLand
from gloc3_sitl.autopilot.behaviours.winged import (
    BySticks,
    CircleFlight,
    CircleLoiter,
    Cruise,
    ManualFlight,
    MissionOnWings,
    ReturnToCircle,
    RunUp,
)
from gloc3_sitl.autopilot.modes import Behaviour, Mode
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.plane_parameters import PARAMETERS, derive

_STICKS: Final = 64
_STEADIED: Final = 64 | 16
_ITSELF: Final = 16 | 8
_MANUAL, _CIRCLE, _STABILIZE, _FBWA, _CRUISE = 0, 1, 2, 5, 7
_AUTO, _RTL, _LOITER, _TAKEOFF, _GUIDED, _AUTOLAND = 10, 11, 12, 13, 15, 26
_TAKE_OFF_COMMAND, _LAND_COMMAND, _ORBIT, _TURN_NOSE = 22, 21, 34, 115

PLANE: Final = replace(
    ARDUPILOT,
    modes=(
        Mode(name="MANUAL", custom_mode=_MANUAL, base_mode=_STICKS, behaviour=Behaviour.DIRECT),
        Mode(name="CIRCLE", custom_mode=_CIRCLE, base_mode=_ITSELF, behaviour=Behaviour.STOP, can_arm=False),
        Mode(name="STABILIZE", custom_mode=_STABILIZE, base_mode=_STEADIED, behaviour=Behaviour.STABILIZE),
        Mode(name="FBWA", custom_mode=_FBWA, base_mode=_STEADIED, behaviour=Behaviour.STEER),
        Mode(name="CRUISE", custom_mode=_CRUISE, base_mode=_STEADIED, behaviour=Behaviour.ALTITUDE),
        Mode(name="AUTO", custom_mode=_AUTO, base_mode=_ITSELF | 4, behaviour=Behaviour.MISSION),
        Mode(name="RTL", custom_mode=_RTL, base_mode=_ITSELF | 4, behaviour=Behaviour.RETURN, can_arm=False),
        Mode(name="LOITER", custom_mode=_LOITER, base_mode=_ITSELF, behaviour=Behaviour.HOLD),
        Mode(name="TAKEOFF", custom_mode=_TAKEOFF, base_mode=_ITSELF, behaviour=Behaviour.TAKE_OFF),
        Mode(name="GUIDED", custom_mode=_GUIDED, base_mode=_ITSELF, behaviour=Behaviour.STREAMED),
        Mode(name="AUTOLAND", custom_mode=_AUTOLAND, base_mode=_ITSELF, behaviour=Behaviour.LAND, can_arm=False),
    ),
    boot_mode=_MANUAL,
    hold_mode=_LOITER,
    brake_mode=_CIRCLE,
    takeoff_mode=_TAKEOFF,
    land_mode=_AUTOLAND,
    return_mode=_RTL,
    mission_mode=_AUTO,
    streamed_mode=_GUIDED,
    position_mode=_LOITER,
    altitude_mode=_CRUISE,
    parameters=PARAMETERS,
    derive=derive,
    activities={
        Behaviour.DIRECT: ManualFlight,
        Behaviour.STOP: CircleFlight,
        Behaviour.STABILIZE: BySticks,
        Behaviour.STEER: BySticks,
        Behaviour.ALTITUDE: Cruise,
        Behaviour.MISSION: MissionOnWings,
        Behaviour.RETURN: ReturnToCircle,
        Behaviour.HOLD: CircleLoiter,
        Behaviour.TAKE_OFF: RunUp,
        Behaviour.STREAMED: CircleLoiter,
        Behaviour.LAND: AutoLand,
    },
    unsupported=frozenset({_TAKE_OFF_COMMAND, _LAND_COMMAND, _ORBIT, _TURN_NOSE}),
)
"""Plane 4.7 with the Aerosonde."""
