"""The supported ArduPilot Rover parameters, with the names, types, units and defaults of Rover 4.7.

Gains, speeds and the battery's are the vehicle's, which names those that differ.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians
from typing import Final

from gloc3_sitl.autopilot.parameters import AutopilotParameter, ParameterKind, real, whole
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PARAMETERS as COPTERS
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PAYLOAD, TRANSMITTER
from gloc3_sitl.autopilot.tuning import Exempt, FailsafeAction, Tuning

_BOAT: Final = 2
_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.HOLD,
}
"""FS_ACTION; a smart return counts as a return, or as a stop where that is its second choice."""
_FENCE: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
}
_POSITION_LOST: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.LAND,
    2: FailsafeAction.WARN,
}
_SHARED: Final = (
    "MAV_SYSID", "MAV_GCS_SYSID", "MAV1_POSITION", "MAV1_EXTRA1", "MAV1_EXTRA2", "MAV1_EXTRA3", "MAV1_EXT_STAT",
    "MAV1_RC_CHAN", "MAV1_RAW_SENS", "FENCE_ENABLE", "FENCE_RADIUS", "FENCE_MARGIN", "FENCE_TOTAL", "MIS_TOTAL",
    "MIS_RESTART", "BATT_MONITOR", "BATT_CAPACITY", "BATT_LOW_MAH", "BATT_CRT_MAH", "BATT_LOW_VOLT",
    "BATT_CRT_VOLT", "BATT_LOW_TIMER", "FS_EKF_THRESH", "FS_GCS_TIMEOUT",
    "AHRS_EKF_TYPE", "EK3_SRC1_POSXY", "EK3_SRC1_VELXY", "EK3_SRC1_POSZ", "EK3_SRC1_YAW", "EK3_SRC2_POSXY",
    "EK3_SRC2_VELXY", "EK3_SRC2_POSZ", "EK3_SRC2_YAW", "VISO_TYPE", "VISO_DELAY_MS", "VISO_QUAL_MIN", "LOG_BITMASK",
)  # fmt: skip
"""Those that are the same in Copter."""

_ROWS: Final = {row.name: row for row in COPTERS}
PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    *(_ROWS[name] for name in _SHARED),
    *TRANSMITTER,
    *PAYLOAD,
    whole("FRAME_CLASS", 1, 0, 3, "1 rover, 2 boat", kind=ParameterKind.INT8),
    whole("FRAME_TYPE", 0, 0, 5, "frame: skid steering", kind=ParameterKind.INT8),
    # Arming and failsafes
    whole("ARMING_CHECK", 1, 0, 1048575, "0 skips the arming checks"),
    whole("ARMING_REQUIRE", 1, 0, 2, "arming is needed", kind=ParameterKind.INT8),
    whole("FS_ACTION", 2, 0, 6, "action on loss of transmitter or station", kind=ParameterKind.INT8),
    real("FS_TIMEOUT", 1.5, 1.0, 100.0, "time-out of the transmitter, s", "pilot_timeout_s"),
    whole("FS_GCS_ENABLE", 0, 0, 2, "station loss: 0 ignored, 1 acts, 2 not in AUTO", kind=ParameterKind.INT8),
    whole("FS_THR_ENABLE", 1, 0, 2, "transmitter loss: 0 ignored, 1 acts, 2 not in AUTO", kind=ParameterKind.INT8),
    whole("FS_THR_VALUE", 910, 910, 1100, "throttle pulse that counts as lost", kind=ParameterKind.INT16),
    whole("FS_EKF_ACTION", 1, 0, 2, "position loss action", "position_lost_action", _POSITION_LOST, ParameterKind.INT8),
    whole("FS_CRASH_CHECK", 0, 0, 2, "crash action", kind=ParameterKind.INT8),
    whole("FS_OPTIONS", 0, 0, 1, "failsafe options"),
    whole("BATT_FS_LOW_ACT", 0, 0, 6, "low battery action", "battery_low_action", _LOST, ParameterKind.INT8),
    whole("BATT_FS_CRT_ACT", 0, 0, 6, "critical battery action", "battery_critical_action", _LOST, ParameterKind.INT8),
    whole("FENCE_TYPE", 6, 0, 7, "circle, polygons", kind=ParameterKind.INT8),
    whole("FENCE_ACTION", 1, 0, 4, "fence action", "fence_action", _FENCE, ParameterKind.INT8),
    # Ways
    whole("INITIAL_MODE", 0, 0, 15, "mode after start", kind=ParameterKind.INT8),
    real("CRUISE_SPEED", 2.0, 0.0, 100.0, "speed at CRUISE_THROTTLE, m/s", "drive.cruise_speed_m_s"),
    whole("CRUISE_THROTTLE", 50, 0, 100, "throttle at CRUISE_SPEED, %", "drive.cruise_throttle", kind=ParameterKind.INT8, scale=0.01),
    real("SPEED_MAX", 0.0, 0.0, 30.0, "largest speed, m/s; 0 is what CRUISE_SPEED gives at full throttle"),
    real("WP_SPEED", 2.0, 0.0, 100.0, "speed in missions, m/s; 0 is CRUISE_SPEED"),
    real("WP_RADIUS", 2.0, 0.0, 100.0, "a waypoint is reached so near, m", "acceptance_radius_m"),
    real("WP_ACCEL", 0.0, 0.0, 100.0, "acceleration in missions; 0 is ATC_ACCEL_MAX"),
    real("WP_JERK", 0.0, 0.0, 100.0, "jerk in missions; 0 is twice the acceleration"),
    whole(
        "WP_PIVOT_ANGLE", 60, 0, 360, "corners that are sharper are turned on the spot, deg; 0 for none",
        "drive.pivot_angle_rad", kind=ParameterKind.INT16, scale=radians(1.0),
    ),
    whole(
        "WP_PIVOT_RATE", 60, 0, 360, "turn rate on the spot, deg/s", "drive.pivot_rate_rad_s", kind=ParameterKind.INT16,
        scale=radians(1.0),
    ),
    real("WP_PIVOT_DELAY", 0.0, 0.0, 60.0, "rest after a turn on the spot, s"),
    real("TURN_RADIUS", 0.9, 0.0, 10.0, "turning radius at low speed, m"),
    real("RTL_SPEED", 0.0, 0.0, 100.0, "return speed, m/s; 0 is WP_SPEED", "drive.return_speed_m_s"),
    real("LOIT_RADIUS", 2.0, 0.0, 20.0, "drifts so far before it goes back, m", "drive.loiter_radius_m"),
    real("LOIT_SPEED_GAIN", 0.5, 0.0, 5.0, "speed per metre beyond that, 1/s", "drive.loiter_gain"),
    whole("LOIT_TYPE", 0, 0, 2, "goes back with bow or stern", kind=ParameterKind.INT8),
    whole("GUID_OPTIONS", 0, 0, 64, "guided options"),
    whole("MIS_DONE_BEHAVE", 0, 0, 3, "at the end of a mission: 0 stays", kind=ParameterKind.INT8),
    # Control
    real("ATC_ACCEL_MAX", 1.0, 0.0, 10.0, "acceleration, m/s^2", "drive.acceleration_m_s2"),
    real("ATC_SPEED_P", 0.2, 0.01, 2.0, "speed gain", "drive.speed_p"),
    real("ATC_SPEED_I", 0.2, 0.0, 2.0, "speed integral gain", "drive.speed_i"),
    real("ATC_SPEED_FF", 0.0, 0.0, 0.5, "speed feed-forward beside CRUISE_THROTTLE", "drive.speed_ff"),
    real("ATC_STR_ANG_P", 2.0, 1.0, 10.0, "heading gain, 1/s", "drive.heading_p"),
    real("ATC_STR_RAT_P", 0.2, 0.0, 2.0, "turn rate gain", "drive.rate_p"),
    real("ATC_STR_RAT_I", 0.2, 0.0, 2.0, "turn rate integral gain", "drive.rate_i"),
    real("ATC_STR_RAT_FF", 0.2, 0.0, 3.0, "turn rate feed-forward", "drive.rate_ff"),
    real("ATC_STR_RAT_MAX", 120.0, 0.0, 1000.0, "largest turn rate, deg/s", "drive.rate_max_rad_s", radians(1.0)),
    real("ATC_STR_ACC_MAX", 120.0, 0.0, 1000.0, "its change, deg/s^2", "drive.rate_change_rad_s2", radians(1.0)),
    real("ATC_TURN_MAX_G", 0.6, 0.1, 10.0, "acceleration in turns, g", "drive.turn_acceleration_m_s2", 9.80665),
    real("MOT_THST_EXPO", 0.0, -1.0, 1.0, "curve of thrust over output", "drive.thrust_curve"),
    real("MOT_THST_ASYM", 1.0, 1.0, 10.0, "thrust ahead over astern", "drive.astern"),
    real("MOT_STR_THR_MIX", 0.5, 0.2, 1.0, "share of steering where both cannot be given", "drive.steering_share"),
    real("PSC_POS_P", 0.2, 0.0, 2.0, "lateral speed per metre of lateral error, 1/s", "drive.position_p"),
    whole("WENC_TYPE", 0, 0, 10, "wheel encoder: 0 none, 1 quadrature", kind=ParameterKind.INT8),
)  # fmt: skip


def with_defaults(differing: Mapping[str, float]) -> tuple[AutopilotParameter, ...]:
    """The table with other defaults."""
    assert set(differing) <= {row.name for row in PARAMETERS}, differing
    return tuple(replace(row, default=differing.get(row.name, row.default)) for row in PARAMETERS)


def derive(request: Callable[[str], float], tuning: Tuning) -> None:
    """What follows from several parameters, or from the bits and choices of one."""
    action = _LOST[int(request("FS_ACTION"))]
    station, pilot = int(request("FS_GCS_ENABLE")), int(request("FS_THR_ENABLE"))
    tuning.station_lost_action = action if station else FailsafeAction.NONE
    tuning.pilot_lost_action = action if pilot else FailsafeAction.NONE
    tuning.station_lost_exempt = Exempt.MISSION if station == 2 else 0  # the parameter's own value
    tuning.pilot_lost_exempt = Exempt.MISSION if pilot == 2 else 0
    tuning.action_delay_s = 0.0
    tuning.pilot_override = 0
    tuning.battery_emergency = 0.0
    capacity = max(1.0, request("BATT_CAPACITY"))
    tuning.battery_low, tuning.battery_critical = request("BATT_LOW_MAH") / capacity, request("BATT_CRT_MAH") / capacity
    kinds = int(request("FENCE_TYPE"))
    tuning.fence_height_m = 0.0
    tuning.fence_radius_m = request("FENCE_RADIUS") if kinds & 2 else 0.0
    tuning.fence_has_polygons = bool(kinds & 4)
    tuning.check_mask = -1 if request("ARMING_CHECK") else 0
    tuning.limits.speed_xy_m_s = request("WP_SPEED") or request("CRUISE_SPEED")
    full = request("CRUISE_SPEED") / max(0.05, 0.01 * request("CRUISE_THROTTLE"))
    tuning.gains.speed_xy_m_s = request("SPEED_MAX") or full
    tuning.limits.acceleration_xy_m_s2 = request("WP_ACCEL") or request("ATC_ACCEL_MAX")
    tuning.disarm_idle_s = -1.0
    tuning.disarm_unflown_s = 0.0
    tuning.stream_timeout_s = 3.0
    is_boat = int(request("FRAME_CLASS")) == _BOAT
    tuning.drive.loiters = is_boat
    tuning.drive.integral = 0.1 if is_boat else 0.0
