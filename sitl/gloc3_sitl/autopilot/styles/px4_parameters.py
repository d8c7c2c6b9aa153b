"""The supported PX4 parameters, with the names, types, bounds and meanings of its parameter reference (v1.16).

Defaults that decide behaviour (failsafes, time-outs) are PX4's; gains, speeds and return heights are the airframe's, as
set by a PX4 airframe file. So are two failsafes that PX4 leaves to the owner: return on a critical battery, and hold
when setpoints stop.
"""

from collections.abc import Callable, Mapping
from math import radians
from typing import Final

from gloc3_sitl.autopilot.parameters import AutopilotParameter, real, whole
from gloc3_sitl.autopilot.tuning import FailsafeAction, Tuning

_STATION_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.HOLD,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.DISARM,
}
_PILOT_LOST: Final[Mapping[int, FailsafeAction]] = {
    1: FailsafeAction.HOLD,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.DISARM,
}
_STREAM_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.POSITION,
    1: FailsafeAction.POSITION,
    2: FailsafeAction.POSITION,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.HOLD,
    6: FailsafeAction.TERMINATE,
    7: FailsafeAction.DISARM,
}
_FENCE: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.WARN,
    2: FailsafeAction.HOLD,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.TERMINATE,
    5: FailsafeAction.LAND,
}
_BATTERY: Final[Mapping[int, tuple[FailsafeAction, FailsafeAction]]] = {
    0: (FailsafeAction.WARN, FailsafeAction.WARN),
    2: (FailsafeAction.LAND, FailsafeAction.LAND),
    3: (FailsafeAction.RETURN, FailsafeAction.LAND),
}
"""Actions of COM_LOW_BAT_ACT on a critical battery and in an emergency."""

_CHANNELS: Final = tuple(
    real(f"RC{number}_{name}", default, least, most, f"{what} of a channel; without effect")
    for number in range(1, 5)
    for name, default, least, most, what in (
        ("MIN", 1000.0, 800.0, 1500.0, "shortest pulse, us,"),
        ("TRIM", 1500.0, 800.0, 2200.0, "centre, us,"),
        ("MAX", 2000.0, 1500.0, 2200.0, "longest pulse, us,"),
        ("REV", 1.0, -1.0, 1.0, "direction"),
    )
)

PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    # Identity and links
    whole("SYS_AUTOSTART", 4001, 0, 9999999, "airframe: generic quadcopter"),
    whole("MAV_SYS_ID", 1, 1, 250, "MAVLink system id"),
    whole("MAV_COMP_ID", 1, 1, 250, "MAVLink component id"),
    whole("MAV_TYPE", 2, 0, 22, "MAVLink vehicle type: quadrotor"),
    # Modes, arming, failsafes
    whole("COM_RC_IN_MODE", 1, 0, 4, "manual control: transmitter, joystick, either, first, none"),
    real("COM_RC_LOSS_T", 0.5, 0.0, 35.0, "manual control loss timeout, s", "pilot_timeout_s"),
    whole("COM_RC_OVERRIDE", 1, 0, 3, "sticks take over: bit 0 auto modes, bit 1 offboard", "pilot_override"),
    real("COM_RC_STICK_OV", 30.0, 5.0, 80.0, "stick deflection that takes over, %", "pilot_override_stick", 0.01),
    *_CHANNELS,
    whole("RC_CHAN_CNT", 0, 0, 18, "channels of the transmitter; without effect"),
    *(
        whole(f"RC_MAP_{stick}", 0, 0, 18, f"channel of {stick.lower()}; without effect")
        for stick in ("ROLL", "PITCH", "THROTTLE", "YAW")
    ),
    whole("NAV_RCL_ACT", 2, 1, 6, "manual control loss action", "pilot_lost_action", _PILOT_LOST),
    whole(
        "COM_RCL_EXCEPT", 0, 0, 31, "modes without manual control loss: mission, hold, offboard", "pilot_lost_exempt"
    ),
    whole("NAV_DLL_ACT", 0, 0, 6, "ground station loss action", "station_lost_action", _STATION_LOST),
    whole("COM_DL_LOSS_T", 10, 5, 300, "ground station loss timeout, s", "station_timeout_s"),
    whole("COM_DLL_EXCEPT", 0, 0, 7, "modes without station loss: mission, hold, offboard", "station_lost_exempt"),
    real("COM_FAIL_ACT_T", 5.0, 0.0, 25.0, "hold before a failsafe, s", "action_delay_s"),
    real("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "offboard loss timeout, s", "stream_timeout_s"),
    whole("COM_OBL_RC_ACT", 5, 0, 7, "offboard loss action", "stream_lost_action", _STREAM_LOST),
    whole("COM_POS_FS_DELAY", 1, 1, 100, "position loss delay, s", "position_lost_s"),
    real("COM_DISARM_LAND", 2.0, -1.0, 3600.0, "disarm after landing, s", "disarm_after_landing_s"),
    real("COM_DISARM_PRFLT", 10.0, -1.0, 3600.0, "disarm when nothing took off, s", "disarm_unflown_s"),
    whole("COM_ARM_WO_GPS", 1, 0, 2, "arming without a position"),
    whole("COM_ARM_ODID", 0, 0, 2, "Remote ID, which reports whether it is good to arm; arming is not refused for it"),
    whole("COM_MOT_TEST_EN", 1, 0, 1, "motor tests are allowed"),
    whole("COM_LOW_BAT_ACT", 3, 0, 3, "critical battery: 0 warn, 2 land, 3 return, and land in an emergency"),
    real("BAT_LOW_THR", 0.15, 0.12, 0.5, "low battery, share", "battery_low"),
    real("BAT_CRIT_THR", 0.1, 0.05, 0.5, "critical battery, share", "battery_critical"),
    real("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "battery emergency, share", "battery_emergency"),
    whole("BAT1_N_CELLS", 3, 0, 16, "cells in series"),
    real("BAT1_CAPACITY", 6250.0, -1.0, 100000.0, "capacity, mAh"),
    whole("COM_FLTMODE1", -1, -1, 15, "mode of the switch's first position"),
    whole("COM_ARM_AUTH_REQ", 0, 0, 1, "arming needs an authorization"),
    whole("COM_ARM_AUTH_ID", 10, 0, 255, "system that gives it"),
    whole("COM_ARM_AUTH_MET", 0, 0, 1, "authorization: with the first attempt to arm, or before a second"),
    real("COM_ARM_AUTH_TO", 1.0, 0.0, 60.0, "authorization timeout, s"),
    # Fence
    whole("GF_ACTION", 2, 0, 5, "fence action", "fence_action", _FENCE),
    real("GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "farthest from home, m", "fence_radius_m"),
    real("GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "highest over home, m", "fence_height_m"),
    whole("GF_SOURCE", 0, 0, 1, "position source of the fence"),
    # Take-off, mission, return, land
    real("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "take-off height, m", "takeoff_height_m"),
    whole("MIS_TKO_LAND_REQ", 0, 0, 5, "mission must have take-off or landing", "mission_requires"),
    whole("MIS_YAWMODE", 1, 0, 4, "heading in missions"),
    real("NAV_ACC_RAD", 2.0, 0.05, 200.0, "acceptance radius, m", "acceptance_radius_m"),
    real("NAV_MC_ALT_RAD", 0.8, 0.05, 200.0, "acceptance height, m"),
    real("RTL_RETURN_ALT", 2.0, 0.0, 2000.0, "return height, m", "return_height_m"),
    real("RTL_DESCEND_ALT", 10.0, 0.0, 2000.0, "height to wait at, m", "return_descend_m"),
    real("RTL_LAND_DELAY", 0.0, -1.0, 3600.0, "wait before landing, s", "return_wait_s"),
    real("RTL_MIN_DIST", 10.0, 0.5, 100.0, "no climb closer to home, m", "return_near_m"),
    whole("RTL_TYPE", 0, 0, 5, "return to home or rally points"),
    real("MPC_TKO_SPEED", 1.5, 1.0, 5.0, "take-off speed, m/s", "takeoff_speed_m_s"),
    real("MPC_LAND_SPEED", 0.7, 0.6, 10.0, "landing speed, m/s", "land_speed_m_s"),
    real("MPC_LAND_ALT2", 5.0, 0.0, 100.0, "height below which landing is slow, m", "land_slow_height_m"),
    real("MPC_Z_V_AUTO_DN", 1.5, 0.5, 4.0, "descent speed in auto modes, m/s", "limits.speed_down_m_s"),
    real("MPC_Z_V_AUTO_UP", 3.0, 0.5, 8.0, "climb speed in auto modes, m/s", "limits.speed_up_m_s"),
    # Position control
    real("MPC_XY_CRUISE", 5.0, 3.0, 20.0, "speed in missions, m/s", "limits.speed_xy_m_s"),
    real("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "largest speed, m/s", "gains.speed_xy_m_s"),
    real("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "largest climb, m/s", "gains.speed_up_m_s"),
    real("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "largest descent, m/s", "gains.speed_down_m_s"),
    real("MPC_ACC_HOR", 3.0, 2.0, 15.0, "horizontal acceleration, m/s^2", "limits.acceleration_xy_m_s2"),
    real("MPC_JERK_AUTO", 6.0, 1.0, 80.0, "jerk in auto modes, m/s^3", "limits.jerk_m_s3"),
    real("MPC_XY_P", 1.3, 0.0, 2.0, "position gain", "gains.position_xy"),
    real("MPC_Z_P", 1.4, 0.1, 1.5, "height gain", "gains.position_z"),
    real("MPC_XY_VEL_P_ACC", 2.6, 1.2, 5.0, "velocity gain", "gains.velocity_p_xy"),
    real("MPC_XY_VEL_I_ACC", 1.0, 0.0, 60.0, "velocity integral gain", "gains.velocity_i_xy"),
    real("MPC_XY_VEL_D_ACC", 0.25, 0.1, 2.0, "velocity derivative gain", "gains.velocity_d_xy"),
    real("MPC_Z_VEL_P_ACC", 5.0, 2.0, 15.0, "vertical velocity gain", "gains.velocity_p_z"),
    real("MPC_Z_VEL_I_ACC", 2.0, 0.2, 3.0, "vertical velocity integral gain", "gains.velocity_i_z"),
    real("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "largest lean, deg", "gains.tilt_rad", radians(1.0)),
    real("MPC_THR_HOVER", 0.46, 0.1, 0.8, "hover thrust", "hover_thrust"),
    real("MPC_THR_MIN", 0.12, 0.05, 0.5, "least thrust", "gains.thrust_min"),
    real("MPC_THR_MAX", 1.0, 0.0, 1.0, "largest thrust", "gains.thrust_max"),
    real("MPC_YAWRAUTO_MAX", 45.0, 5.0, 360.0, "fastest turn in auto modes, deg/s", "yaw_rate_rad_s", radians(1.0)),
    real("MC_ROLL_P", 6.5, 0.0, 12.0, "roll gain", "attitude_p_roll"),
    real("MC_PITCH_P", 6.5, 0.0, 12.0, "pitch gain", "attitude_p_pitch"),
    real("MC_YAW_P", 2.8, 0.0, 5.0, "yaw gain", "attitude_p_yaw"),
    # Estimator
    whole("EKF2_EN", 1, 0, 1, "estimator is on"),
    whole("EKF2_GPS_CTRL", 7, 0, 15, "GPS: position, height, velocity, heading"),
    whole("EKF2_EV_CTRL", 0, 0, 15, "vision: position, height, velocity, heading"),
    whole("EKF2_BARO_CTRL", 1, 0, 1, "barometer is used"),
    whole("EKF2_MAG_TYPE", 0, 0, 6, "magnetometer: automatic, ..., 5 none"),
    whole("EKF2_HGT_REF", 1, 0, 3, "height reference: barometer, GPS, range, vision"),
    real("EKF2_EV_DELAY", 0.0, 0.0, 300.0, "vision latency, ms"),
    whole("EKF2_EV_QMIN", 0, 0, 100, "least vision quality"),
    whole("SYS_FAILURE_EN", 0, 0, 1, "failures may be injected"),
    real("FLW_TGT_HT", 8.0, 8.0, 1000.0, "follow: height, m", "follow_height_m"),
    real("FLW_TGT_DST", 8.0, 1.0, 1000.0, "follow: distance, m", "follow_distance_m"),
    real("FLW_TGT_FA", 180.0, -180.0, 180.0, "follow: bearing from the course, deg", "follow_bearing_deg"),
    real("FLW_TGT_RS", 0.1, 0.0, 1.0, "follow: responsiveness"),
    real("FLW_TGT_MAX_VEL", 5.0, 0.0, 20.0, "follow: speed around the target, m/s"),
    whole("FLW_TGT_ALT_M", 0, 0, 2, "follow: height over home, ground, target", "follow_height_over"),
    real("MC_ORBIT_RAD_MAX", 1000.0, 1.0, 10000.0, "largest orbit, m", "orbit_radius_m"),
    whole("PD_GRIPPER_EN", 0, 0, 1, "there is a gripper"),
    whole("SDLOG_MODE", 0, -1, 4, "when to log"),
    whole("CAL_MAG0_ID", 197388, -2147483648, 2147483647, "magnetometer's device id"),
    whole("CAL_GYRO0_ID", 2490378, -2147483648, 2147483647, "gyro's device id"),
    whole("CAL_ACC0_ID", 2490378, -2147483648, 2147483647, "accelerometer's device id"),
)


def derive(request: Callable[[str], float], tuning: Tuning) -> None:
    """What follows from several parameters, or from the bits and choices of one."""
    tuning.needs_position_to_arm = request("COM_ARM_WO_GPS") == 0.0
    tuning.pilot_required = request("COM_RC_IN_MODE") == 0.0
    if request("COM_RC_IN_MODE") == _NO_MANUAL_CONTROL:
        tuning.pilot_lost_action = FailsafeAction.NONE
    else:
        tuning.pilot_lost_action = _PILOT_LOST.get(int(request("NAV_RCL_ACT")), FailsafeAction.RETURN)
    critical, emergency = _BATTERY.get(int(request("COM_LOW_BAT_ACT")), _BATTERY[0])
    tuning.battery_critical_action, tuning.battery_emergency_action = critical, emergency
    tuning.disarm_idle_s = tuning.disarm_after_landing_s
    tuning.mission_faces_course = request("MIS_YAWMODE") in (1.0, 4.0)


_NO_MANUAL_CONTROL: Final = 4.0
