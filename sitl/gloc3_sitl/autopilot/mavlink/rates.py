"""Default message rates of a link, and ArduPilot's message groups."""

from collections.abc import Mapping
from typing import Final

from gloc3_sitl.autopilot.mavlink.links import LinkKind
from gloc3_sitl.autopilot.mavlink.telemetry import producers

_SLOW: Final = {
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "GPS_RAW_INT": 1.0,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "MISSION_CURRENT": 1.0,
    "SYSTEM_TIME": 1.0,
}

_DEFAULTS: Final[Mapping[str, Mapping[LinkKind, Mapping[str, float]]]] = {
    "px4": {
        LinkKind.GROUND: {
            **_SLOW,
            "ALTITUDE": 1.0,
            "ATTITUDE": 10.0,
            "ATTITUDE_QUATERNION": 4.0,
            "DISTANCE_SENSOR": 0.5,
            "ESTIMATOR_STATUS": 0.5,
            "GLOBAL_POSITION_INT": 5.0,
            "LOCAL_POSITION_NED": 4.0,
            "ORBIT_EXECUTION_STATUS": 2.0,
            "RC_CHANNELS": 5.0,
            "SCALED_PRESSURE": 1.0,
            "SERVO_OUTPUT_RAW": 1.0,
            "VFR_HUD": 4.0,
        },
        LinkKind.COMPANION: {
            **_SLOW,
            "ALTITUDE": 1.0,
            "ATTITUDE_QUATERNION": 25.0,
            "DISTANCE_SENSOR": 10.0,
            "ESTIMATOR_STATUS": 1.0,
            "GLOBAL_POSITION_INT": 5.0,
            "LOCAL_POSITION_NED": 25.0,
            "POSITION_TARGET_LOCAL_NED": 1.0,
        },
    },
    # ArduPilot is silent until somebody asks, by SET_MESSAGE_INTERVAL, REQUEST_DATA_STREAM or a stream parameter.
    "ardupilot": {},
}


def starting_rates(style: str, kind: LinkKind) -> dict[str, float]:
    """Rates in Hz at which a link begins; 0 for what is only sent when somebody asks."""
    return dict.fromkeys(producers(style), 0.0) | dict(_DEFAULTS[style].get(kind, {}))


GROUPS: Final[Mapping[int, tuple[str, ...]]] = {
    1: ("RAW_IMU", "SCALED_IMU", "SCALED_PRESSURE"),
    2: ("SYS_STATUS", "MISSION_CURRENT", "GPS_RAW_INT", "FENCE_STATUS"),
    3: ("RC_CHANNELS", "SERVO_OUTPUT_RAW"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE",),
    11: ("VFR_HUD",),
    12: ("BATTERY_STATUS", "DISTANCE_SENSOR", "EKF_STATUS_REPORT", "EXTENDED_SYS_STATE", "SYSTEM_TIME"),
}
"""ArduPilot's groups of messages (MAV_DATA_STREAM)."""

GROUP_PARAMETERS: Final[Mapping[str, int]] = {
    "MAV1_RAW_SENS": 1,
    "MAV1_EXT_STAT": 2,
    "MAV1_RC_CHAN": 3,
    "MAV1_POSITION": 6,
    "MAV1_EXTRA1": 10,
    "MAV1_EXTRA2": 11,
    "MAV1_EXTRA3": 12,
}
"""ArduPilot's parameters for the groups; here they act on all links."""
