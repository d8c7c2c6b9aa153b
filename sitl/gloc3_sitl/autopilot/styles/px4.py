"""PX4's style: main and sub modes, refusals as TEMPORARILY_REJECTED, Offboard that needs a stream."""

from typing import Final

from gloc3_sitl.autopilot.logs.ulog import UlogFormat
from gloc3_sitl.autopilot.modes import Behaviour, Mode, Result, StyleTables
from gloc3_sitl.autopilot.styles.px4_parameters import PARAMETERS, derive

MANUAL: Final = 64 | 16
"""MAV_MODE_FLAG: manual input, stabilized."""
AUTO: Final = 16 | 8 | 4
"""MAV_MODE_FLAG: stabilized, guided, auto."""


def px4_mode(main: int, sub: int = 0) -> int:
    """The custom mode of a main mode and an auto sub mode."""
    return main << 16 | sub << 24


_HOLD: Final = px4_mode(4, 3)
_LAND: Final = px4_mode(4, 6)
_RETURN: Final = px4_mode(4, 5)
_MISSION: Final = px4_mode(4, 4)
_TAKE_OFF: Final = px4_mode(4, 2)
_POSITION: Final = px4_mode(3)
_ALTITUDE: Final = px4_mode(2)
_OFFBOARD: Final = px4_mode(6)
_ORBIT: Final = px4_mode(3, 1)
_FOLLOW: Final = px4_mode(4, 8)

PX4: Final = StyleTables(
    name="px4",
    autopilot=12,
    modes=(
        Mode(name="Manual", custom_mode=px4_mode(1), base_mode=MANUAL, behaviour=Behaviour.STABILIZE),
        Mode(name="Stabilized", custom_mode=px4_mode(7), base_mode=MANUAL, behaviour=Behaviour.STABILIZE),
        Mode(name="Altitude", custom_mode=_ALTITUDE, base_mode=MANUAL, behaviour=Behaviour.ALTITUDE),
        Mode(name="Position", custom_mode=_POSITION, base_mode=MANUAL, behaviour=Behaviour.POSITION),
        Mode(name="Takeoff", custom_mode=_TAKE_OFF, base_mode=AUTO, behaviour=Behaviour.TAKE_OFF),
        Mode(name="Hold", custom_mode=_HOLD, base_mode=AUTO, behaviour=Behaviour.HOLD),
        Mode(name="Mission", custom_mode=_MISSION, base_mode=AUTO, behaviour=Behaviour.MISSION),
        Mode(name="Return", custom_mode=_RETURN, base_mode=AUTO, behaviour=Behaviour.RETURN, can_arm=False),
        Mode(name="Land", custom_mode=_LAND, base_mode=AUTO, behaviour=Behaviour.LAND, can_arm=False),
        Mode(name="Orbit", custom_mode=_ORBIT, base_mode=AUTO, behaviour=Behaviour.ORBIT, can_arm=False),
        Mode(name="Follow", custom_mode=_FOLLOW, base_mode=AUTO, behaviour=Behaviour.FOLLOW, can_arm=False),
        Mode(name="Offboard", custom_mode=_OFFBOARD, base_mode=AUTO, behaviour=Behaviour.STREAMED),
    ),
    boot_mode=_HOLD,
    goes_on={Behaviour.TAKE_OFF: _HOLD, Behaviour.MISSION: _HOLD},
    keeps_intention=True,
    fence_is_critical=True,
    hold_mode=_HOLD,
    brake_mode=_HOLD,
    takeoff_mode=_TAKE_OFF,
    land_mode=_LAND,
    return_mode=_RETURN,
    mission_mode=_MISSION,
    streamed_mode=_OFFBOARD,
    position_mode=_POSITION,
    altitude_mode=_ALTITUDE,
    parameters=PARAMETERS,
    derive=derive,
    refused=Result.TEMPORARILY_REJECTED,
    unknown_mode=Result.UNSUPPORTED,
    arming_prefix="Arming denied: ",
    reports_by_event=True,
    streamed_needs_stream=True,
    streamed_shapes_positions=False,
    log_folder="/fs/microsd/log",
    make_log=UlogFormat,
    mission_keeps_home=False,
    pilot_disarms_in_air=False,
    takeoff_in_streamed=False,
    version=(1, 16, 0),
    on_earth=frozenset(
        {
            Behaviour.TAKE_OFF,
            Behaviour.HOLD,
            Behaviour.MISSION,
            Behaviour.RETURN,
            Behaviour.ORBIT,
            Behaviour.FOLLOW,
        }
    ),
    orbit_mode=_ORBIT,
)
"""PX4 v1.16 as a multicopter."""
