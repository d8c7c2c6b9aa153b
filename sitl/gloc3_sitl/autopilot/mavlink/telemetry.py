"""Every message that the autopilot can tell about itself, by name."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from gloc3.link.message import MavlinkMessage
from gloc3_sitl.autopilot.mavlink import motion_telemetry, state_telemetry

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot

Producer = Callable[["Autopilot"], MavlinkMessage | None]

PRODUCERS: Final[dict[str, Producer]] = {
    "ALTITUDE": motion_telemetry.altitude,
    "ATTITUDE": motion_telemetry.attitude,
    "ATTITUDE_QUATERNION": motion_telemetry.attitude_quaternion,
    "ATTITUDE_TARGET": motion_telemetry.attitude_target,
    "BATTERY_STATUS": state_telemetry.battery_status,
    "DISTANCE_SENSOR": motion_telemetry.distance_sensor,
    "EKF_STATUS_REPORT": state_telemetry.ekf_status,
    "ESTIMATOR_STATUS": state_telemetry.estimator_status,
    "EXTENDED_SYS_STATE": state_telemetry.extended_sys_state,
    "FENCE_STATUS": state_telemetry.fence_status,
    "GLOBAL_POSITION_INT": motion_telemetry.global_position,
    "GPS_GLOBAL_ORIGIN": state_telemetry.global_origin,
    "GPS_RAW_INT": motion_telemetry.gps_raw,
    "HIGHRES_IMU": motion_telemetry.highres_imu,
    "HOME_POSITION": state_telemetry.home_position,
    "LOCAL_POSITION_NED": motion_telemetry.local_position,
    "MISSION_CURRENT": state_telemetry.mission_current,
    "POSITION_TARGET_LOCAL_NED": motion_telemetry.position_target,
    "SCALED_IMU": motion_telemetry.scaled_imu,
    "SYSTEM_TIME": state_telemetry.system_time,
    "SYS_STATUS": state_telemetry.sys_status,
    "VFR_HUD": motion_telemetry.vfr_hud,
}
"""By the name of the message; None means that there is nothing to tell now."""
