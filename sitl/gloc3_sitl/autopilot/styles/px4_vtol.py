"""PX4's style for VTOLs: transitions by command and in missions, holds and returns in the form that it flies in."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians
from typing import Final

from gloc3_sitl.autopilot.behaviours import vtol
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.parameters import AutopilotParameter, real, whole
from gloc3_sitl.autopilot.styles.px4 import PX4
from gloc3_sitl.autopilot.styles.px4_parameters import PARAMETERS as COPTERS
from gloc3_sitl.autopilot.styles.px4_parameters import derive as derive_copter
from gloc3_sitl.autopilot.tuning import FailsafeAction, Tuning

_QUAD_CHUTE: Final[Mapping[int, FailsafeAction]] = {
    -1: FailsafeAction.WARN,
    0: FailsafeAction.RETURN,
    1: FailsafeAction.LAND,
    2: FailsafeAction.HOLD,
}
_OWN: Final[Mapping[str, float]] = {
    "SYS_AUTOSTART": 13000.0,
    "MAV_TYPE": 22.0,
    "MIS_TAKEOFF_ALT": 20.0,
    "MIS_TKO_LAND_REQ": 2.0,
    "NAV_ACC_RAD": 10.0,
    "RTL_TYPE": 1.0,
    "RTL_RETURN_ALT": 60.0,
    "RTL_DESCEND_ALT": 20.0,
    "BAT1_N_CELLS": 12.0,
    "BAT1_CAPACITY": 20_000.0,
    "MPC_TKO_SPEED": 2.5,
    "MPC_XY_VEL_MAX": 8.0,
    "MPC_ACC_HOR": 2.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_XY_P": 0.9,
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_TILTMAX_AIR": 25.0,
    "MPC_THR_HOVER": 0.51,
    "MPC_YAWRAUTO_MAX": 30.0,
    "MC_ROLL_P": 4.5,
    "MC_PITCH_P": 4.5,
    "MC_YAW_P": 1.6,
}
"""What PX4 sets for VTOLs, and the airframe's."""
_LEFT_OUT: Final = ("FLW_", "MC_ORBIT")

PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    *(
        replace(row, default=_OWN.get(row.name, row.default))
        for row in COPTERS
        if not row.name.startswith(_LEFT_OUT)
    ),
    # Transitions
    whole("VT_TYPE", 2, 0, 2, "VTOL: 2 standard"),
    real("VT_ARSP_BLEND", 13.0, 0.0, 30.0, "air speed from which rotors give way, m/s", "vtol.blend_m_s"),
    real("VT_ARSP_TRANS", 20.0, 0.0, 30.0, "air speed at which the wings have it, m/s", "vtol.wings_m_s"),
    real("VT_TRANS_MIN_TM", 2.0, 0.0, 20.0, "least time of a transition to wings, s", "vtol.wings_least_s"),
    real("VT_TRANS_TIMEOUT", 15.0, 0.1, 30.0, "longest one, s", "vtol.wings_most_s"),
    real("VT_PSHER_SLEW", 0.33, 0.0, 1.0, "rise of its throttle, 1/s", "vtol.pusher_per_s"),
    real("VT_B_TRANS_DUR", 15.0, 0.1, 20.0, "longest transition to rotors, s", "vtol.rotors_most_s"),
    real("VT_B_DEC_MSS", 3.0, 0.5, 10.0, "deceleration in it, m/s^2", "vtol.braking_m_s2"),
    real("VT_FW_MIN_ALT", 0.0, 0.0, 200.0, "quad-chute below on wings, m; 0 never", "vtol.wings_height_m"),
    whole("COM_QC_ACT", 0, -1, 2, "after a quad-chute: -1 goes on, 0 returns, 1 lands, 2 holds", "transition_action", _QUAD_CHUTE),
    whole("NAV_FORCE_VT", 1, 0, 1, "lands on rotors"),
    # Wings
    real("FW_AIRSPD_TRIM", 25.0, 0.5, 40.0, "air speed, m/s", "wings.cruise_m_s"),
    real("FW_AIRSPD_MIN", 20.0, 0.5, 40.0, "least air speed, m/s", "wings.slowest_m_s"),
    real("FW_AIRSPD_MAX", 32.0, 0.5, 40.0, "largest air speed, m/s", "wings.fastest_m_s"),
    real("NAV_LOITER_RAD", 100.0, -1000.0, 1000.0, "radius of circles, m", "wings.circle_m"),
    real("FW_R_LIM", 45.0, 35.0, 65.0, "largest bank, deg", "wings.roll_max_rad", radians(1.0)),
    real("FW_P_LIM_MAX", 20.0, 0.0, 60.0, "nose up, deg", "wings.pitch_max_rad", radians(1.0)),
    real("FW_P_LIM_MIN", -15.0, -60.0, 0.0, "nose down, deg", "wings.pitch_min_rad", radians(1.0)),
    real("FW_THR_TRIM", 0.78, 0.0, 1.0, "throttle of cruise", "wings.throttle_trim"),
    real("FW_THR_MAX", 1.0, 0.0, 1.0, "largest throttle", "wings.throttle_max"),
    real("FW_T_CLMB_MAX", 3.0, 1.0, 15.0, "climb, m/s", "wings.climb_max_m_s"),
    real("FW_T_SINK_MIN", 2.2, 1.0, 5.0, "sink without throttle, m/s", "wings.sink_min_m_s"),
    real("FW_T_SINK_MAX", 3.5, 1.0, 15.0, "largest sink, m/s", "wings.sink_max_m_s"),
    real("NPFG_PERIOD", 12.0, 1.0, 100.0, "period of guidance, s", "wings.guidance_s"),
    real("NPFG_DAMPING", 0.75, 0.1, 1.0, "damping of guidance", "wings.guidance_damping"),
)  # fmt: skip


def derive(request: Callable[[str], float], tuning: Tuning) -> None:
    """What follows from several parameters, or from the bits and choices of one."""
    derive_copter(request, tuning)
    tuning.wings.return_height_m = request("RTL_RETURN_ALT")
    tuning.limits.jerk_m_s3 = request("MPC_JERK_AUTO")
    tuning.vtol.rotors_m_s = request("MPC_XY_CRUISE")


_REMOVED: Final = (Behaviour.ORBIT, Behaviour.FOLLOW)
PX4_VTOL: Final = replace(
    PX4,
    modes=tuple(mode for mode in PX4.modes if mode.behaviour not in _REMOVED),
    parameters=PARAMETERS,
    derive=derive,
    activities={
        Behaviour.STABILIZE: vtol.stabilize,
        Behaviour.ALTITUDE: vtol.altitude,
        Behaviour.POSITION: vtol.position,
        Behaviour.HOLD: vtol.hold,
        Behaviour.MISSION: vtol.VtolMission,
        Behaviour.RETURN: vtol.return_home,
        Behaviour.LAND: vtol.land,
        Behaviour.STREAMED: vtol.offboard,
    },
    orbit_mode=None,
)
"""PX4 v1.16 as a standard VTOL."""
