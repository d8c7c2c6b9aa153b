"""ArduPilot's style: Copter's mode numbers, refusals as FAILED, take-off and streamed control in Guided."""

from typing import Final

from gloc3_sitl.autopilot.behaviours.land import LandAfterGoal
from gloc3_sitl.autopilot.logs.dataflash import DataflashFormat
from gloc3_sitl.autopilot.modes import Behaviour, Mode, Result, StyleTables
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PARAMETERS, derive

_MANUAL: Final = 64 | 16
_AUTO: Final = 16 | 8

_STABILIZE: Final = 0
_ALT_HOLD: Final = 2
_AUTO_MODE: Final = 3
_GUIDED: Final = 4
_LOITER: Final = 5
_RTL: Final = 6
_LAND: Final = 9
_POSHOLD: Final = 16
_BRAKE: Final = 17
_GUIDED_NOGPS: Final = 20

ARDUPILOT: Final = StyleTables(
    name="ardupilot",
    autopilot=3,
    modes=(
        Mode(name="STABILIZE", custom_mode=_STABILIZE, base_mode=_MANUAL, behaviour=Behaviour.STABILIZE),
        Mode(name="ALT_HOLD", custom_mode=_ALT_HOLD, base_mode=_MANUAL, behaviour=Behaviour.ALTITUDE),
        Mode(name="AUTO", custom_mode=_AUTO_MODE, base_mode=_AUTO | 4, behaviour=Behaviour.MISSION),
        Mode(name="GUIDED", custom_mode=_GUIDED, base_mode=_AUTO, behaviour=Behaviour.STREAMED),
        Mode(name="LOITER", custom_mode=_LOITER, base_mode=_MANUAL | 8, behaviour=Behaviour.POSITION),
        Mode(name="RTL", custom_mode=_RTL, base_mode=_AUTO, behaviour=Behaviour.RETURN, can_arm=False),
        Mode(name="LAND", custom_mode=_LAND, base_mode=_AUTO, behaviour=Behaviour.LAND, can_arm=False),
        Mode(name="POSHOLD", custom_mode=_POSHOLD, base_mode=_MANUAL | 8, behaviour=Behaviour.POSITION),
        Mode(name="BRAKE", custom_mode=_BRAKE, base_mode=_AUTO, behaviour=Behaviour.BRAKE, can_arm=False),
        Mode(name="GUIDED_NOGPS", custom_mode=_GUIDED_NOGPS, base_mode=_AUTO, behaviour=Behaviour.STREAMED_ATTITUDE),
    ),
    boot_mode=_STABILIZE,
    goes_on={},
    keeps_intention=False,
    fence_is_critical=False,
    hold_mode=_BRAKE,
    brake_mode=_BRAKE,
    takeoff_mode=_GUIDED,
    land_mode=_LAND,
    return_mode=_RTL,
    mission_mode=_AUTO_MODE,
    streamed_mode=_GUIDED,
    position_mode=_LOITER,
    altitude_mode=_ALT_HOLD,
    parameters=PARAMETERS,
    derive=derive,
    refused=Result.FAILED,
    unknown_mode=Result.FAILED,
    arming_prefix="PreArm: ",
    reports_by_event=False,
    streamed_needs_stream=False,
    streamed_shapes_positions=True,
    log_folder="/APM/LOGS",
    make_log=DataflashFormat,
    mission_keeps_home=True,
    pilot_disarms_in_air=True,
    takeoff_in_streamed=True,
    activities={Behaviour.LAND: LandAfterGoal},
    version=(4, 7, 0),
)
"""ArduPilot Copter 4.7; the other vehicles' styles derive from it."""
