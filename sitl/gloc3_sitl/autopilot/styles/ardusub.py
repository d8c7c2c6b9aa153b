"""ArduSub's style: its mode numbers, depth in place of height, no take-off and no landing."""

from dataclasses import replace
from typing import Final

from gloc3_sitl.autopilot.behaviours.submarine import DepthHold, Sticks, Surface
from gloc3_sitl.autopilot.modes import Behaviour, Mode
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.ardusub_parameters import PARAMETERS, derive

_MANUAL: Final = 64 | 16
_AUTO: Final = 16 | 8

_STABILIZE: Final = 0
_ALT_HOLD: Final = 2
_AUTO_MODE: Final = 3
_GUIDED: Final = 4
_SURFACE: Final = 9
_POSHOLD: Final = 16
_MANUAL_MODE: Final = 19
_MOTOR_DETECT: Final = 20

_TAKE_OFF, _LAND, _RETURN, _VTOL_TAKE_OFF, _VTOL_LAND = 22, 21, 20, 84, 85

ARDUSUB: Final = replace(
    ARDUPILOT,
    modes=(
        Mode(name="STABILIZE", custom_mode=_STABILIZE, base_mode=_MANUAL, behaviour=Behaviour.STABILIZE),
        Mode(name="ALT_HOLD", custom_mode=_ALT_HOLD, base_mode=_MANUAL, behaviour=Behaviour.ALTITUDE),
        Mode(name="AUTO", custom_mode=_AUTO_MODE, base_mode=_AUTO | 4, behaviour=Behaviour.MISSION),
        Mode(name="GUIDED", custom_mode=_GUIDED, base_mode=_AUTO, behaviour=Behaviour.STREAMED),
        Mode(name="SURFACE", custom_mode=_SURFACE, base_mode=_AUTO, behaviour=Behaviour.LAND),
        Mode(name="POSHOLD", custom_mode=_POSHOLD, base_mode=_MANUAL | 8, behaviour=Behaviour.POSITION),
        Mode(name="MANUAL", custom_mode=_MANUAL_MODE, base_mode=_MANUAL, behaviour=Behaviour.STABILIZE),
        Mode(
            name="MOTOR_DETECT",
            custom_mode=_MOTOR_DETECT,
            base_mode=_MANUAL,
            behaviour=Behaviour.TERMINATED,
            can_arm=False,
        ),
    ),
    boot_mode=_MANUAL_MODE,
    hold_mode=_POSHOLD,
    brake_mode=_POSHOLD,
    takeoff_mode=_GUIDED,
    land_mode=_SURFACE,
    return_mode=_SURFACE,
    mission_mode=_AUTO_MODE,
    streamed_mode=_GUIDED,
    position_mode=_ALT_HOLD,
    altitude_mode=_ALT_HOLD,
    parameters=PARAMETERS,
    derive=derive,
    activities={Behaviour.STABILIZE: Sticks, Behaviour.ALTITUDE: DepthHold, Behaviour.LAND: Surface},
    unsupported=frozenset({_TAKE_OFF, _LAND, _RETURN, _VTOL_TAKE_OFF, _VTOL_LAND}),
    disarms_under_way=True,
)
"""ArduSub 4.7."""
