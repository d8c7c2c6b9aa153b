"""All telemetry messages of the autopilot, by name and style."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from gloc3.mavlink.message import MavlinkMessage
from gloc3_sitl.autopilot.mavlink import motion_telemetry, output_telemetry, state_telemetry

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot

Producer = Callable[["Autopilot"], MavlinkMessage | None]

_PRODUCERS: Final[dict[str, Producer]] = {
    "ACTUATOR_OUTPUT_STATUS": output_telemetry.actuator_output,
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
    "FLIGHT_INFORMATION": output_telemetry.flight_information,
    "GLOBAL_POSITION_INT": motion_telemetry.global_position,
    "GPS_GLOBAL_ORIGIN": state_telemetry.global_origin,
    "GPS_RAW_INT": motion_telemetry.gps_raw,
    "HIL_STATE_QUATERNION": output_telemetry.ground_truth,
    "HIGHRES_IMU": motion_telemetry.highres_imu,
    "HOME_POSITION": state_telemetry.home_position,
    "LOCAL_POSITION_NED": motion_telemetry.local_position,
    "MISSION_CURRENT": state_telemetry.mission_current,
    "ODOMETRY": output_telemetry.odometry_out,
    "OPEN_DRONE_ID_ARM_STATUS": state_telemetry.remote_id_status,
    "ORBIT_EXECUTION_STATUS": output_telemetry.orbit_status,
    "POSITION_TARGET_LOCAL_NED": motion_telemetry.position_target,
    "RAW_IMU": output_telemetry.raw_imu,
    "RC_CHANNELS": output_telemetry.rc_channels,
    "SCALED_IMU": motion_telemetry.scaled_imu,
    "SCALED_PRESSURE": output_telemetry.scaled_pressure,
    "SERVO_OUTPUT_RAW": output_telemetry.servo_output,
    "SYSTEM_TIME": state_telemetry.system_time,
    "SYS_STATUS": state_telemetry.sys_status,
    "VFR_HUD": motion_telemetry.vfr_hud,
    "WHEEL_DISTANCE": output_telemetry.wheel_distance,
}
"""Producer of each message, by its name; one that returns None has nothing to send."""

_NOT_REPORTED: Final[Mapping[str, frozenset[str]]] = {
    "px4": frozenset({"EKF_STATUS_REPORT", "FENCE_STATUS", "RAW_IMU", "WHEEL_DISTANCE"}),
    "ardupilot": frozenset(
        {
            "ACTUATOR_OUTPUT_STATUS",
            "ALTITUDE",
            "ESTIMATOR_STATUS",
            "HIL_STATE_QUATERNION",
            "ODOMETRY",
            "ORBIT_EXECUTION_STATUS",
        }
    ),
}
"""What the firmware of a style has no stream for."""


def producers(style: str) -> dict[str, Producer]:
    """Returns the telemetry producers of a style."""
    return {name: produce for name, produce in _PRODUCERS.items() if name not in _NOT_REPORTED[style]}
