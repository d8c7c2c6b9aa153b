"""ArduPilot's style for quadplanes: Plane's modes, and those on rotors."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians
from typing import Final

from gloc3_sitl.autopilot.behaviours import vtol
from gloc3_sitl.autopilot.behaviours.piloted import Altitude, Position, Stabilize
from gloc3_sitl.autopilot.behaviours.winged import BySticks, CircleFlight, Cruise, ManualFlight
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import Behaviour, Mode
from gloc3_sitl.autopilot.parameters import AutopilotParameter, ParameterKind, real, whole
from gloc3_sitl.autopilot.styles.plane import PLANE
from gloc3_sitl.autopilot.styles.plane_parameters import LONG
from gloc3_sitl.autopilot.styles.plane_parameters import PARAMETERS as PLANES
from gloc3_sitl.autopilot.styles.plane_parameters import derive as derive_plane
from gloc3_sitl.autopilot.tuning import FailsafeAction, Tuning

_STICKS, _STEADIED, _ITSELF = 64, 64 | 16, 16 | 8
_RTL, _LOITER, _GUIDED, _AUTOLAND, _TAKEOFF = 11, 12, 15, 26, 13
_QSTABILIZE, _QHOVER, _QLOITER, _QLAND, _QRTL = 17, 18, 19, 20, 21
_TAKE_OFF_COMMAND = 22
_FAILED: Final[Mapping[int, FailsafeAction]] = {
    -1: FailsafeAction.WARN,
    0: FailsafeAction.LAND,
    1: FailsafeAction.RETURN,
}
_RETURNS: Final[Mapping[int, bool]] = {0: False, 1: True, 2: True, 3: True}
_LONG: Final[Mapping[int, FailsafeAction]] = {**LONG, 2: FailsafeAction.RETURN}
"""Where a plane would glide, or circle, it returns."""
_OWN: Final[Mapping[str, float]] = {
    "AIRSPEED_CRUISE": 25.0,
    "AIRSPEED_MIN": 20.0,
    "WP_LOITER_RAD": 100.0,
    "TRIM_THROTTLE": 78.0,
    "TECS_CLMB_MAX": 3.0,
    "TECS_SINK_MIN": 2.2,
    "TECS_SINK_MAX": 3.5,
}
_INT8: Final = ParameterKind.INT8

PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    *(
        replace(row, default=_OWN.get(row.name, row.default))
        for row in PLANES
        if not row.name.startswith(("AUTOLAND_", "TKOFF_", "GROUND_"))
    ),
    whole("Q_ENABLE", 1, 0, 2, "rotors: 0 none", kind=_INT8),
    whole("Q_FRAME_CLASS", 1, 0, 14, "rotors: 1 quad", kind=_INT8),
    whole("Q_FRAME_TYPE", 1, 0, 18, "their places: 1 X", kind=_INT8),
    whole("Q_MAV_TYPE", 0, 0, 28, "type in the heartbeat; 0 is a plane's", kind=_INT8),
    whole("Q_OPTIONS", 0, 0, 8388607, "options; 2 and 4 are take-off and landing on wings"),
    whole("Q_GUIDED_MODE", 0, 0, 2, "1 has Guided hover", "vtol.guided_hovers", {0: False, 1: True, 2: True}, _INT8),
    whole("Q_RTL_MODE", 0, 0, 3, "1 lands on rotors after RTL", "vtol.return_lands", _RETURNS, _INT8),
    whole("Q_TRANS_FAIL", 0, 0, 20, "longest transition to wings, s; 0 no limit", kind=_INT8),
    whole("Q_TRANS_FAIL_ACT", 0, -1, 1, "after it: -1 warns, 0 QLAND, 1 QRTL", "transition_action", _FAILED, _INT8),
    real("Q_TRANS_DECEL", 3.0, 0.2, 5.0, "deceleration of transitions to rotors, m/s^2", "vtol.braking_m_s2"),
    whole("Q_RTL_ALT", 15, 1, 200, "height of returns on rotors, m", "return_height_m", kind=ParameterKind.INT16),
    real("Q_LAND_FINAL_SPD", 0.5, 0.3, 2.0, "landing speed, m/s", "land_speed_m_s"),
    real("Q_LAND_FINAL_ALT", 6.0, 0.5, 50.0, "height below which landing is slow, m", "land_slow_height_m"),
    real("Q_PILOT_SPD_UP", 2.5, 0.5, 5.0, "climb on rotors, m/s", "gains.speed_up_m_s"),
    real("Q_WP_SPEED", 500.0, 20.0, 2000.0, "speed on rotors, cm/s", "limits.speed_xy_m_s", 0.01),
    real("Q_WP_ACCEL", 200.0, 50.0, 500.0, "acceleration on rotors, cm/s^2", "limits.acceleration_xy_m_s2", 0.01),
    whole("Q_ANGLE_MAX", 2500, 1000, 8000, "largest lean on rotors, cdeg", "gains.tilt_rad", None, ParameterKind.INT16, radians(0.01)),
    real("Q_A_ANG_RLL_P", 4.5, 3.0, 12.0, "roll gain on rotors", "attitude_p_roll"),
    real("Q_A_ANG_PIT_P", 4.5, 3.0, 12.0, "pitch gain on rotors", "attitude_p_pitch"),
    real("Q_A_ANG_YAW_P", 1.6, 1.0, 12.0, "yaw gain on rotors", "attitude_p_yaw"),
    real("Q_P_POSXY_P", 0.9, 0.5, 4.0, "position gain on rotors", "gains.position_xy"),
    real("Q_P_VELXY_P", 1.8, 0.1, 6.0, "velocity gain on rotors", "gains.velocity_p_xy"),
    real("Q_P_VELXY_I", 0.4, 0.0, 1.0, "velocity integral gain on rotors", "gains.velocity_i_xy"),
    real("Q_M_THST_HOVER", 0.51, 0.125, 0.6875, "hover thrust", "hover_thrust"),
)  # fmt: skip


def derive(request: Callable[[str], float], tuning: Tuning) -> None:
    """What follows from several parameters, or from the bits and choices of one."""
    derive_plane(request, tuning, _LONG)
    tuning.vtol.wings_m_s = request("AIRSPEED_MIN")
    tuning.vtol.wings_most_s = request("Q_TRANS_FAIL")
    tuning.vtol.gives_up = request("Q_TRANS_FAIL_ACT") >= 0.0
    tuning.vtol.rotors_m_s = tuning.limits.speed_xy_m_s = 0.01 * request("Q_WP_SPEED")
    tuning.limits.jerk_m_s3 = 4.0
    tuning.gains.speed_xy_m_s = 8.0
    tuning.takeoff_speed_m_s = request("Q_PILOT_SPD_UP")
    tuning.yaw_rate_rad_s = 0.5
    tuning.mission_uses_item_yaw = False
    tuning.return_descend_m = request("Q_RTL_ALT")
    tuning.return_near_m = 0.0


def _sticks(craft: Craft) -> vtol.TwoForms:
    return vtol.TwoForms(craft, Stabilize, BySticks, wings=True)


def _manual(craft: Craft) -> vtol.TwoForms:
    return vtol.TwoForms(craft, Stabilize, ManualFlight, wings=True)


def _cruise(craft: Craft) -> vtol.TwoForms:
    return vtol.TwoForms(craft, Altitude, Cruise, wings=True)


def _circle(craft: Craft) -> vtol.TwoForms:
    return vtol.TwoForms(craft, Altitude, CircleFlight, wings=True)


def _on_rotors(make: vtol.MakeActivity) -> vtol.MakeActivity:
    return lambda craft: vtol.TwoForms(craft, make, vtol.StraightOn, wings=False)


_UNUSED: Final = (_AUTOLAND, _TAKEOFF)
QUADPLANE: Final = replace(
    PLANE,
    modes=(
        *(mode for mode in PLANE.modes if mode.custom_mode not in _UNUSED),
        Mode(name="QSTABILIZE", custom_mode=_QSTABILIZE, base_mode=_STEADIED, behaviour=Behaviour.Q_STABILIZE),
        Mode(name="QHOVER", custom_mode=_QHOVER, base_mode=_STEADIED, behaviour=Behaviour.Q_ALTITUDE),
        Mode(name="QLOITER", custom_mode=_QLOITER, base_mode=_STEADIED, behaviour=Behaviour.POSITION),
        Mode(name="QLAND", custom_mode=_QLAND, base_mode=16, behaviour=Behaviour.LAND, can_arm=False),
        Mode(name="QRTL", custom_mode=_QRTL, base_mode=_ITSELF, behaviour=Behaviour.Q_RETURN, can_arm=False),
    ),
    hold_mode=_GUIDED,
    brake_mode=_GUIDED,
    takeoff_mode=_GUIDED,
    land_mode=_QLAND,
    return_mode=_RTL,
    position_mode=_QLOITER,
    altitude_mode=_QHOVER,
    parameters=PARAMETERS,
    derive=derive,
    activities={
        Behaviour.DIRECT: _manual,
        Behaviour.STOP: _circle,
        Behaviour.STABILIZE: _sticks,
        Behaviour.STEER: _sticks,
        Behaviour.ALTITUDE: _cruise,
        Behaviour.MISSION: vtol.QuadplaneMission,
        Behaviour.RETURN: vtol.return_home,
        Behaviour.HOLD: vtol.loiter,
        Behaviour.STREAMED: vtol.VtolGuided,
        Behaviour.LAND: vtol.land,
        Behaviour.Q_STABILIZE: _on_rotors(Stabilize),
        Behaviour.Q_ALTITUDE: _on_rotors(Altitude),
        Behaviour.POSITION: _on_rotors(Position),
        Behaviour.Q_RETURN: vtol.return_on_rotors,
    },
    unsupported=PLANE.unsupported - {_TAKE_OFF_COMMAND},
)
"""Plane 4.7 with the Aerosonde on four lift rotors."""
