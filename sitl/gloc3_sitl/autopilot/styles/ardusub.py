"""ArduSub's style: its mode numbers, depth in place of height, no take-off and no landing."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians
from typing import Final

from gloc3_sitl.autopilot.behaviours.submarine import DepthHold, SubmarineSticks, SurfaceMode
from gloc3_sitl.autopilot.modes import Behaviour, Mode
from gloc3_sitl.autopilot.parameters import AutopilotParameter, ParameterKind, real, whole
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PARAMETERS as COPTER
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PAYLOAD
from gloc3_sitl.autopilot.tuning import FailsafeAction, Tuning

_STATION_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.WARN,
    2: FailsafeAction.DISARM,
    3: FailsafeAction.POSITION,
    4: FailsafeAction.LAND,
}
_LEAK: Final[Mapping[int, FailsafeAction]] = {0: FailsafeAction.NONE, 1: FailsafeAction.WARN, 2: FailsafeAction.LAND}
_POSITION_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.WARN,
    2: FailsafeAction.DISARM,
}
_PILOT_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.WARN,
    2: FailsafeAction.DISARM,
}
_BATTERY: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    2: FailsafeAction.DISARM,
    3: FailsafeAction.LAND,
}
_FENCE: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.POSITION,
    2: FailsafeAction.LAND,
}
_CENTI: Final = 0.01

_SHARED: Final = (
    *("MAV_SYSID", "MAV_GCS_SYSID", "MAV1_POSITION", "MAV1_EXTRA1", "MAV1_EXTRA2", "MAV1_EXTRA3", "MAV1_EXT_STAT"),
    *("MAV1_RC_CHAN", "MAV1_RAW_SENS", "FS_GCS_TIMEOUT", "FS_EKF_THRESH", "BATT_MONITOR", "BATT_CAPACITY"),
    *("BATT_LOW_VOLT", "BATT_CRT_VOLT", "BATT_LOW_TIMER"),
    *("BATT_LOW_MAH", "BATT_CRT_MAH", "FENCE_ENABLE", "FENCE_ALT_MAX", "FENCE_RADIUS", "FENCE_MARGIN"),
    *("FENCE_TOTAL", "GUID_OPTIONS", "MIS_TOTAL", "MIS_RESTART", "AHRS_EKF_TYPE", "EK3_SRC1_POSXY", "EK3_SRC1_VELXY"),
    *("EK3_SRC1_POSZ", "EK3_SRC1_YAW", "VISO_DELAY_MS", "VISO_QUAL_MIN", "LOG_BITMASK"),
)
"""Those that are the same as Copter's."""

PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    *(row for row in COPTER if row.name in _SHARED),
    *PAYLOAD,
    whole("FRAME_CONFIG", 2, 0, 7, "frame: vectored with six degrees of freedom", kind=ParameterKind.INT8),
    # Arming and failsafes
    whole("ARMING_CHECK", 448, 0, 2**22, "arming checks: bits; 0 skips them"),
    whole("FS_GCS_ENABLE", 0, 0, 4, "station loss action", "station_lost_action", _STATION_LOST, ParameterKind.INT8),
    whole("FS_LEAK_ENABLE", 2, 0, 2, "leak action", "leak_action", _LEAK, ParameterKind.INT8),
    whole("FS_EKF_ACTION", 0, 0, 2, "position loss action", "position_lost_action", _POSITION_LOST, ParameterKind.INT8),
    whole("FS_PILOT_INPUT", 2, 0, 2, "transmitter loss action", "pilot_lost_action", _PILOT_LOST, ParameterKind.INT8),
    real("FS_PILOT_TIMEOUT", 3.0, 0.1, 3.0, "transmitter loss timeout, s", "pilot_timeout_s"),
    whole("BATT_FS_LOW_ACT", 0, 0, 3, "low battery action", "battery_low_action", _BATTERY, ParameterKind.INT8),
    whole(
        "BATT_FS_CRT_ACT", 0, 0, 3, "critical battery action", "battery_critical_action", _BATTERY, ParameterKind.INT8
    ),
    whole("FENCE_ACTION", 1, 0, 2, "fence action", "fence_action", _FENCE, ParameterKind.INT8),
    whole("FENCE_TYPE", 15, 0, 15, "height, circle, polygons, depth", kind=ParameterKind.INT8),
    real("FENCE_ALT_MIN", -100.0, -100.0, 100.0, "lowest over home, m"),
    real("SURFACE_DEPTH", -10.0, -50.0, 0.0, "height of the vehicle at the surface, cm"),
    # Estimator: satellites at the surface, and the dead reckoning of a companion as the second set of sources
    whole("VISO_TYPE", 1, 0, 3, "vision: 0 none, 1 MAVLink", kind=ParameterKind.INT8),
    whole("EK3_SRC2_POSXY", 6, 0, 6, "second set: position", kind=ParameterKind.INT8),
    whole("EK3_SRC2_VELXY", 6, 0, 7, "second set: velocity", kind=ParameterKind.INT8),
    whole("EK3_SRC2_POSZ", 1, 0, 6, "second set: height", kind=ParameterKind.INT8),
    whole("EK3_SRC2_YAW", 1, 0, 8, "second set: heading", kind=ParameterKind.INT8),
    # Missions and guided control
    real("GUID_TIMEOUT", 3.0, 0.1, 5.0, "guided timeout, s", "stream_timeout_s"),
    real("WPNAV_SPEED", 100.0, 10.0, 2000.0, "speed in missions, cm/s", "limits.speed_xy_m_s", _CENTI),
    real("WPNAV_SPEED_UP", 40.0, 10.0, 1000.0, "climb speed, cm/s", "limits.speed_up_m_s", _CENTI),
    real("WPNAV_SPEED_DN", 40.0, 10.0, 500.0, "descent speed, cm/s", "limits.speed_down_m_s", _CENTI),
    real("WPNAV_ACCEL", 30.0, 5.0, 500.0, "horizontal acceleration, cm/s^2", "limits.acceleration_xy_m_s2", _CENTI),
    real("WPNAV_ACCEL_Z", 20.0, 5.0, 500.0, "vertical acceleration, cm/s^2", "limits.acceleration_z_m_s2", _CENTI),
    real("WPNAV_JERK", 1.0, 0.5, 20.0, "jerk, m/s^3", "limits.jerk_m_s3"),
    real("WPNAV_RADIUS", 200.0, 5.0, 1000.0, "acceptance radius, cm", "acceptance_radius_m", _CENTI),
    whole("WP_YAW_BEHAVIOR", 4, 0, 4, "heading in missions", kind=ParameterKind.INT8),
    real("PILOT_SPEED_UP", 50.0, 20.0, 500.0, "pilot's climb speed, cm/s"),
    real("PILOT_SPEED_DN", 0.0, 0.0, 500.0, "pilot's descent speed, cm/s; 0 is that of the climb"),
    # Control
    real("LOIT_SPEED", 200.0, 20.0, 3500.0, "largest speed, cm/s", "gains.speed_xy_m_s", _CENTI),
    real("PSC_POSXY_P", 0.5, 0.1, 4.0, "position gain", "gains.position_xy"),
    real("PSC_POSZ_P", 0.6, 0.1, 4.0, "depth gain", "gains.position_z"),
    real("PSC_VELXY_P", 1.2, 0.1, 8.0, "velocity gain", "gains.velocity_p_xy"),
    real("PSC_VELXY_I", 0.15, 0.0, 2.0, "velocity integral gain", "gains.velocity_i_xy"),
    real("PSC_VELZ_P", 1.5, 0.1, 10.0, "vertical velocity gain", "gains.velocity_p_z"),
    real("PSC_VELZ_I", 0.3, 0.0, 2.0, "vertical velocity integral gain", "gains.velocity_i_z"),
    real("ATC_SLEW_YAW", 6000.0, 500.0, 18000.0, "fastest turn in missions, cdeg/s", "yaw_rate_rad_s", radians(_CENTI)),
)


def derive(request: Callable[[str], float], tuning: Tuning) -> None:
    """What follows from several parameters, or from the bits and choices of one."""
    tuning.station_lost_exempt = tuning.pilot_lost_exempt = 0
    tuning.action_delay_s = 0.0
    tuning.pilot_override = 0
    tuning.battery_emergency = 0.0
    tuning.check_mask = -1 if request("ARMING_CHECK") else 0
    tuning.needs_position_to_arm = False
    tuning.hover_thrust = 0.5
    tuning.floats_at_m = -request("SURFACE_DEPTH") * _CENTI
    capacity = max(1.0, request("BATT_CAPACITY"))
    tuning.battery_low, tuning.battery_critical = request("BATT_LOW_MAH") / capacity, request("BATT_CRT_MAH") / capacity
    kinds = int(request("FENCE_TYPE"))
    tuning.fence_height_m = request("FENCE_ALT_MAX") if kinds & 1 else 0.0
    tuning.fence_radius_m = request("FENCE_RADIUS") if kinds & 2 else 0.0
    tuning.fence_has_polygons = bool(kinds & 4)
    tuning.fence_depth_m = -request("FENCE_ALT_MIN") if kinds & 8 else 0.0
    tuning.mission_uses_item_yaw = False
    tuning.mission_faces_course = request("WP_YAW_BEHAVIOR") != 0.0
    tuning.disarm_after_landing_s = tuning.disarm_idle_s = tuning.disarm_unflown_s = -1.0
    tuning.gains.speed_up_m_s = max(request("WPNAV_SPEED_UP"), request("PILOT_SPEED_UP")) * _CENTI
    tuning.gains.speed_down_m_s = (
        max(request("WPNAV_SPEED_DN"), request("PILOT_SPEED_DN") or request("PILOT_SPEED_UP")) * _CENTI
    )


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
    activities={Behaviour.STABILIZE: SubmarineSticks, Behaviour.ALTITUDE: DepthHold, Behaviour.LAND: SurfaceMode},
    goes_on={Behaviour.LAND: _ALT_HOLD},
    unsupported=frozenset({_TAKE_OFF, _LAND, _RETURN, _VTOL_TAKE_OFF, _VTOL_LAND}),
    disarms_in_motion=True,
)
"""ArduSub 4.7."""
