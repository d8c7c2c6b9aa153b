"""The supported ArduPilot parameters, with the names, types and units of Copter 4.7.

Defaults that decide behaviour (failsafes, time-outs) are ArduPilot's; gains, speeds and battery values are the
airframe's, with a return on low battery. Stream rates are those of its first link and apply to every link.
"""

from collections.abc import Callable, Mapping
from math import radians
from typing import Final

from gloc3_sitl.autopilot.parameters import AutopilotParameter, ParameterKind, real, whole
from gloc3_sitl.autopilot.tuning import Exempt, FailsafeAction, Tuning

_STATION_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.RETURN,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.LAND,
    7: FailsafeAction.BRAKE,
}
_PILOT_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.RETURN,
    3: FailsafeAction.LAND,
    4: FailsafeAction.RETURN,
    5: FailsafeAction.LAND,
    7: FailsafeAction.BRAKE,
}
_FENCE: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.BRAKE,
    5: FailsafeAction.LAND,
}
_BATTERY: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.LAND,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    7: FailsafeAction.BRAKE,
}
_POSITION_LOST: Final[Mapping[int, FailsafeAction]] = {
    1: FailsafeAction.LAND,
    2: FailsafeAction.POSITION,
    3: FailsafeAction.LAND,
}
_CRASH: Final[Mapping[int, FailsafeAction]] = {0: FailsafeAction.NONE, 1: FailsafeAction.DISARM}
_CHECKS_SKIPPED: Final[Mapping[int, int]] = {0: -1, 1: 0}

TRANSMITTER: Final = (
    *(
        whole(f"RC{number}_{name}", default, 800, 2200, f"{what} of a channel, us; without effect")
        for number in range(1, 5)
        for name, default, what in (("MIN", 1100, "shortest pulse"), ("TRIM", 1500, "centre"), ("MAX", 1900, "longest"))
    ),
    *(
        whole(f"RCMAP_{stick}", number, 1, 16, f"channel of {stick.lower()}; without effect")
        for number, stick in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), start=1)
    ),
)
"""Those of the transmitter, the same for every vehicle; the embedded autopilot takes the sticks as they are."""

PAYLOAD: Final = (
    whole("GRIP_ENABLE", 0, 0, 1, "there is a gripper", kind=ParameterKind.INT8),
    whole("WINCH_TYPE", 0, 0, 2, "there is a winch", kind=ParameterKind.INT8),
    *(
        whole(f"RELAY{number}_FUNCTION", 0, 0, 10, "1: a relay for commands", kind=ParameterKind.INT8)
        for number in range(1, 7)
    ),
)
"""Those of the payload, the same for every vehicle."""

PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    # Identity and links
    whole("MAV_SYSID", 1, 1, 255, "MAVLink system id", kind=ParameterKind.INT16),
    whole("MAV_GCS_SYSID", 255, 1, 255, "system id of my ground station", "station_system", kind=ParameterKind.INT16),
    whole("DID_ENABLE", 0, 0, 1, "Remote ID; arming is not refused for it", kind=ParameterKind.INT8),
    whole("FRAME_CLASS", 1, 0, 17, "frame: quad", kind=ParameterKind.INT8),
    whole("FRAME_TYPE", 1, 0, 19, "frame: X", kind=ParameterKind.INT8),
    whole("MAV1_POSITION", 0, 0, 50, "stream rate of positions, Hz", kind=ParameterKind.INT16),
    whole("MAV1_EXTRA1", 0, 0, 50, "stream rate of attitude, Hz", kind=ParameterKind.INT16),
    whole("MAV1_EXTRA2", 0, 0, 50, "stream rate of VFR_HUD, Hz", kind=ParameterKind.INT16),
    whole("MAV1_EXTRA3", 0, 0, 50, "stream rate of slow state, Hz", kind=ParameterKind.INT16),
    whole("MAV1_EXT_STAT", 0, 0, 50, "stream rate of status, Hz", kind=ParameterKind.INT16),
    whole("MAV1_RC_CHAN", 0, 0, 50, "stream rate of sticks and outputs, Hz", kind=ParameterKind.INT16),
    whole("MAV1_RAW_SENS", 0, 0, 50, "stream rate of raw sensors, Hz", kind=ParameterKind.INT16),
    # Arming and failsafes
    whole("ARMING_SKIPCHK", 0, 0, 1, "1 skips the arming checks", "check_mask", _CHECKS_SKIPPED),
    whole("DISARM_DELAY", 10, 0, 127, "disarm when idle on the ground, s", kind=ParameterKind.INT8),
    whole("FS_GCS_ENABLE", 0, 0, 7, "station loss action", "station_lost_action", _STATION_LOST, ParameterKind.INT8),
    real("FS_GCS_TIMEOUT", 5.0, 2.0, 120.0, "station loss timeout, s", "station_timeout_s"),
    whole("FS_THR_ENABLE", 1, 0, 7, "transmitter loss action", "pilot_lost_action", _PILOT_LOST, ParameterKind.INT8),
    whole("FS_CRASH_CHECK", 1, 0, 1, "disarms what has crashed", "crash_action", _CRASH, ParameterKind.INT8),
    whole("FS_OPTIONS", 16, 0, 511, "modes in which failsafes change nothing"),
    whole("FS_EKF_ACTION", 1, 1, 3, "position loss action", "position_lost_action", _POSITION_LOST, ParameterKind.INT8),
    real("FS_EKF_THRESH", 0.8, 0.6, 1.0, "estimator variance that counts as failure"),
    whole("FS_DR_ENABLE", 2, 0, 6, "dead reckoning action", kind=ParameterKind.INT8),
    whole("FS_DR_TIMEOUT", 30, 0, 120, "dead reckoning timeout, s", kind=ParameterKind.INT16),
    *TRANSMITTER,
    *PAYLOAD,
    whole("ESC_CALIBRATION", 0, 0, 9, "3: the ESCs are calibrated at the next start", kind=ParameterKind.INT8),
    real("RC_FS_TIMEOUT", 1.0, 0.5, 10.0, "transmitter loss timeout, s", "pilot_timeout_s"),
    whole("BATT_MONITOR", 4, 0, 29, "battery monitor: voltage and current", kind=ParameterKind.INT8),
    whole("BATT_CAPACITY", 6250, 0, 1000000, "capacity, mAh"),
    real("BATT_LOW_MAH", 625.0, 0.0, 1000000.0, "low battery, mAh left"),
    real("BATT_CRT_MAH", 437.0, 0.0, 1000000.0, "critical battery, mAh left"),
    real("BATT_LOW_VOLT", 0.0, 0.0, 120.0, "low battery, V", "battery_low_v"),
    real("BATT_CRT_VOLT", 0.0, 0.0, 120.0, "critical battery, V", "battery_critical_v"),
    whole("BATT_LOW_TIMER", 10, 0, 120, "wait below a voltage, s", "battery_wait_s", kind=ParameterKind.INT8),
    whole("BATT_FS_LOW_ACT", 2, 0, 7, "low battery action", "battery_low_action", _BATTERY, ParameterKind.INT8),
    whole(
        "BATT_FS_CRT_ACT", 0, 0, 7, "critical battery action", "battery_critical_action", _BATTERY, ParameterKind.INT8
    ),
    # Fence
    whole("FENCE_ENABLE", 0, 0, 1, "fence is on", "fence_is_on", kind=ParameterKind.INT8),
    whole("FENCE_TYPE", 7, 0, 15, "height, circle, polygons", kind=ParameterKind.INT8),
    whole("FENCE_ACTION", 1, 0, 8, "fence action", "fence_action", _FENCE, ParameterKind.INT8),
    real("FENCE_ALT_MAX", 100.0, 0.0, 1000.0, "highest over home, m"),
    real("FENCE_RADIUS", 300.0, 30.0, 10000.0, "farthest from home, m"),
    real("FENCE_MARGIN", 2.0, 1.0, 10.0, "distance kept from the fence, m", "fence_margin_m"),
    whole("FENCE_TOTAL", 0, 0, 255, "items of the fence", kind=ParameterKind.INT16),
    # Take-off, mission, return, land
    real("PILOT_TKO_ALT_M", 0.0, 0.0, 10.0, "pilot's take-off height, m"),
    real("PILOT_SPD_UP", 2.5, 0.5, 5.0, "pilot's climb speed, m/s"),
    real("PILOT_SPD_DN", 0.0, 0.0, 5.0, "pilot's descent speed, m/s"),
    whole("GUID_OPTIONS", 0, 0, 511, "guided options"),
    real("GUID_TIMEOUT", 3.0, 0.1, 5.0, "guided timeout, s", "stream_timeout_s"),
    whole("MIS_TOTAL", 0, 0, 32766, "items of the mission", kind=ParameterKind.INT16),
    whole("MIS_RESTART", 0, 0, 1, "mission restarts in AUTO", kind=ParameterKind.INT8),
    whole("WP_YAW_BEHAVIOR", 2, 0, 3, "heading in missions", kind=ParameterKind.INT8),
    real("WP_SPD", 5.0, 0.1, 20.0, "speed in missions, m/s", "limits.speed_xy_m_s"),
    real("WP_SPD_UP", 2.5, 0.1, 10.0, "climb speed, m/s", "limits.speed_up_m_s"),
    real("WP_SPD_DN", 1.5, 0.1, 5.0, "descent speed, m/s", "limits.speed_down_m_s"),
    real("WP_ACC", 2.5, 0.5, 5.0, "horizontal acceleration, m/s^2", "limits.acceleration_xy_m_s2"),
    real("WP_ACC_Z", 2.0, 0.5, 5.0, "vertical acceleration, m/s^2", "limits.acceleration_z_m_s2"),
    real("WP_JERK", 6.0, 1.0, 20.0, "jerk, m/s^3", "limits.jerk_m_s3"),
    real("WP_RADIUS_M", 2.0, 0.05, 10.0, "acceptance radius, m", "acceptance_radius_m"),
    real("RTL_ALT_M", 2.0, 0.3, 3000.0, "return height, m", "return_height_m"),
    real("RTL_ALT_FINAL_M", 0.0, 0.0, 10.0, "height to wait at, m; 0 lands"),
    real("RTL_CLIMB_MIN_M", 0.0, 0.0, 30.0, "least climb, m"),
    whole("RTL_LOIT_TIME", 5000, 0, 60000, "wait before landing, ms", "return_wait_s", scale=0.001),
    real("RTL_SPEED_MS", 0.0, 0.0, 20.0, "return speed, m/s; 0 is WP_SPD"),
    real("LAND_SPD_MS", 0.5, 0.3, 2.0, "landing speed, m/s", "land_speed_m_s"),
    real("LAND_SPD_HIGH_MS", 1.5, 0.0, 5.0, "landing speed higher up, m/s", "land_fast_speed_m_s"),
    real("LAND_ALT_LOW_M", 5.0, 1.0, 100.0, "height below which landing is slow, m", "land_slow_height_m"),
    # Control
    real("LOIT_SPEED_MS", 8.0, 0.2, 35.0, "largest speed, m/s", "gains.speed_xy_m_s"),
    real("PSC_NE_POS_P", 1.3, 0.5, 4.0, "position gain", "gains.position_xy"),
    real("PSC_D_POS_P", 1.4, 0.5, 4.0, "height gain", "gains.position_z"),
    real("PSC_NE_VEL_P", 2.6, 0.1, 6.0, "velocity gain", "gains.velocity_p_xy"),
    real("PSC_NE_VEL_I", 1.0, 0.0, 2.0, "velocity integral gain", "gains.velocity_i_xy"),
    real("PSC_NE_VEL_D", 0.25, 0.0, 1.0, "velocity derivative gain", "gains.velocity_d_xy"),
    real("PSC_D_VEL_P", 5.0, 1.0, 8.0, "vertical velocity gain", "gains.velocity_p_z"),
    real("ATC_ANGLE_MAX", 35.0, 10.0, 80.0, "largest lean, deg", "gains.tilt_rad", radians(1.0)),
    real("ATC_RATE_WPY_MAX", 60.0, 5.0, 360.0, "fastest turn in missions, deg/s", "yaw_rate_rad_s", radians(1.0)),
    real("ATC_ANG_RLL_P", 6.5, 3.0, 12.0, "roll gain", "attitude_p_roll"),
    real("ATC_ANG_PIT_P", 6.5, 3.0, 12.0, "pitch gain", "attitude_p_pitch"),
    real("ATC_ANG_YAW_P", 2.8, 1.0, 12.0, "yaw gain", "attitude_p_yaw"),
    real("MOT_THST_HOVER", 0.46, 0.125, 0.6875, "hover thrust", "hover_thrust"),
    real("MOT_SPIN_MIN", 0.15, 0.0, 0.3, "least throttle in flight"),
    # Estimator
    whole("AHRS_EKF_TYPE", 3, 0, 11, "estimator", kind=ParameterKind.INT8),
    whole("EK3_SRC1_POSXY", 3, 0, 6, "position: 0 none, 3 GPS, 6 external", kind=ParameterKind.INT8),
    whole("EK3_SRC1_VELXY", 3, 0, 7, "velocity: 0 none, 3 GPS, 6 external", kind=ParameterKind.INT8),
    whole("EK3_SRC1_POSZ", 3, 0, 6, "height: 1 barometer, 2 range, 3 GPS, 6 external", kind=ParameterKind.INT8),
    whole("EK3_SRC1_YAW", 1, 0, 8, "heading: 1 compass, 6 external", kind=ParameterKind.INT8),
    whole("EK3_SRC2_POSXY", 0, 0, 6, "second set: position", kind=ParameterKind.INT8),
    whole("EK3_SRC2_VELXY", 0, 0, 7, "second set: velocity", kind=ParameterKind.INT8),
    whole("EK3_SRC2_POSZ", 1, 0, 6, "second set: height", kind=ParameterKind.INT8),
    whole("EK3_SRC2_YAW", 0, 0, 8, "second set: heading", kind=ParameterKind.INT8),
    whole("VISO_TYPE", 0, 0, 3, "vision: 0 none, 1 MAVLink", kind=ParameterKind.INT8),
    whole("VISO_DELAY_MS", 10, 0, 250, "vision latency, ms", kind=ParameterKind.INT16),
    whole("VISO_QUAL_MIN", 0, -1, 100, "least vision quality", kind=ParameterKind.INT8),
    whole("LOG_BITMASK", 176126, 0, 1048575, "what is logged"),
)


def derive(request: Callable[[str], float], tuning: Tuning) -> None:
    """What follows from several parameters, or from the bits and choices of one."""
    options = int(request("FS_OPTIONS"))
    station = pilot = 0
    if options & 1:
        pilot |= Exempt.MISSION
    if options & 2:
        station |= Exempt.MISSION
    if options & 4:
        pilot |= Exempt.STREAMED
    if options & 8:
        station |= Exempt.LANDING
        pilot |= Exempt.LANDING
    if options & 16:
        station |= Exempt.PILOT
    tuning.station_lost_exempt, tuning.pilot_lost_exempt = station, pilot
    tuning.action_delay_s = 0.0
    tuning.pilot_override = 0
    tuning.battery_emergency = 0.0
    capacity = max(1.0, request("BATT_CAPACITY"))
    tuning.battery_low, tuning.battery_critical = request("BATT_LOW_MAH") / capacity, request("BATT_CRT_MAH") / capacity
    kinds = int(request("FENCE_TYPE"))
    tuning.fence_height_m = request("FENCE_ALT_MAX") if kinds & 1 else 0.0
    tuning.fence_radius_m = request("FENCE_RADIUS") if kinds & 2 else 0.0
    tuning.fence_has_polygons = bool(kinds & 4)
    tuning.mission_uses_item_yaw = False
    tuning.mission_faces_course = request("WP_YAW_BEHAVIOR") != 0.0
    tuning.return_descend_m = request("RTL_ALT_FINAL_M")
    tuning.return_near_m = 0.0
    tuning.disarm_after_landing_s = 0.1
    tuning.disarm_unflown_s = request("DISARM_DELAY")
    tuning.disarm_idle_s = request("DISARM_DELAY") or -1.0
    tuning.gains.speed_up_m_s = max(request("WP_SPD_UP"), request("PILOT_SPD_UP"))
    tuning.gains.speed_down_m_s = max(request("WP_SPD_DN"), request("PILOT_SPD_DN"), request("LAND_SPD_HIGH_MS"))
