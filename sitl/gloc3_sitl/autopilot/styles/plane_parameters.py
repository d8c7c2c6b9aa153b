"""The supported ArduPilot Plane parameters, with the names, types and units of Plane 4.7.

Airframe-specific defaults (gains, speeds, radii, battery) are those of the Aerosonde.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians
from typing import Final

from gloc3_sitl.autopilot.parameters import AutopilotParameter, ParameterKind, real, whole
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PARAMETERS as COPTERS
from gloc3_sitl.autopilot.styles.ardupilot_parameters import PAYLOAD, TRANSMITTER
from gloc3_sitl.autopilot.tuning import Exempt, FailsafeAction, Tuning

LONG: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.BRAKE,
    3: FailsafeAction.TERMINATE,
    4: FailsafeAction.NONE,
    5: FailsafeAction.LAND,
}
"""FS_LONG_ACTN; gliding (2) becomes circling here, and AUTO (4) continues."""
_BATTERY: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.TERMINATE,
    4: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.HOLD,
    7: FailsafeAction.LAND,
}
_FENCE: Final[Mapping[int, FailsafeAction]] = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    6: FailsafeAction.HOLD,
    7: FailsafeAction.HOLD,
    8: FailsafeAction.RETURN,
}
_SHARED: Final = (
    "MAV_SYSID", "MAV_GCS_SYSID", "MAV1_POSITION", "MAV1_EXTRA1", "MAV1_EXTRA2", "MAV1_EXTRA3", "MAV1_EXT_STAT",
    "MAV1_RC_CHAN", "MAV1_RAW_SENS", "FENCE_ENABLE", "FENCE_RADIUS", "FENCE_MARGIN", "FENCE_TOTAL", "MIS_TOTAL",
    "MIS_RESTART", "BATT_MONITOR", "BATT_CAPACITY", "BATT_LOW_MAH", "BATT_CRT_MAH", "BATT_LOW_VOLT",
    "BATT_CRT_VOLT", "BATT_LOW_TIMER", "AHRS_EKF_TYPE", "EK3_SRC1_POSXY",
    "EK3_SRC1_VELXY", "EK3_SRC1_POSZ", "EK3_SRC1_YAW", "EK3_SRC2_POSXY", "EK3_SRC2_VELXY", "EK3_SRC2_POSZ",
    "EK3_SRC2_YAW", "VISO_TYPE", "VISO_DELAY_MS", "VISO_QUAL_MIN", "LOG_BITMASK",
)  # fmt: skip
"""Those that are the same in Copter."""
_OWN: Final[Mapping[str, float]] = {"BATT_CAPACITY": 20_000, "BATT_LOW_MAH": 4_000.0, "BATT_CRT_MAH": 2_000.0}

_ROWS: Final = {row.name: row for row in COPTERS}
PARAMETERS: Final[tuple[AutopilotParameter, ...]] = (
    *(replace(_ROWS[name], default=_OWN.get(name, _ROWS[name].default)) for name in _SHARED),
    *TRANSMITTER,
    *PAYLOAD,
    # Arming and failsafes
    whole("ARMING_CHECK", 1, 0, 1048575, "0 skips the arming checks"),
    whole("ARMING_REQUIRE", 1, 0, 2, "arming is needed", kind=ParameterKind.INT8),
    whole("FS_SHORT_ACTN", 0, 0, 4, "at once when a link is lost: 0 circles, not in missions", kind=ParameterKind.INT8),
    real("FS_SHORT_TIMEOUT", 1.5, 1.0, 100.0, "time-out of the transmitter, s", "pilot_timeout_s"),
    whole("FS_LONG_ACTN", 0, 0, 5, "after FS_LONG_TIMEOUT: 1 returns, 2 circles, 5 lands", kind=ParameterKind.INT8),
    real("FS_LONG_TIMEOUT", 5.0, 1.0, 300.0, "time-out of the station, s", "station_timeout_s"),
    whole("FS_GCS_ENABL", 0, 0, 3, "station loss: 0 ignored, 1 acts, 3 not in AUTO", kind=ParameterKind.INT8),
    whole("THR_FAILSAFE", 1, 0, 2, "transmitter loss: 0 ignored, 1 acts", kind=ParameterKind.INT8),
    whole("BATT_FS_LOW_ACT", 0, 0, 7, "low battery action", "battery_low_action", _BATTERY, ParameterKind.INT8),
    whole("BATT_FS_CRT_ACT", 0, 0, 7, "critical battery action", "battery_critical_action", _BATTERY, ParameterKind.INT8),
    whole("FENCE_TYPE", 4, 0, 15, "1 height, 2 circle, 4 polygons", kind=ParameterKind.INT8),
    whole("FENCE_ACTION", 1, 0, 8, "fence action", "fence_action", _FENCE, ParameterKind.INT8),
    real("FENCE_ALT_MAX", 100.0, 10.0, 1000.0, "height of the fence, m"),
    # Ways
    whole("INITIAL_MODE", 0, 0, 26, "mode after start", kind=ParameterKind.INT8),
    real("AIRSPEED_CRUISE", 23.0, 0.0, 60.0, "air speed, m/s", "wings.cruise_m_s"),
    whole("AIRSPEED_MIN", 18, 5, 100, "least air speed, m/s", "wings.slowest_m_s", kind=ParameterKind.INT16),
    whole("AIRSPEED_MAX", 32, 5, 100, "largest air speed, m/s", "wings.fastest_m_s", kind=ParameterKind.INT16),
    whole("ARSPD_TYPE", 1, 0, 100, "pitot tube: 0 none", kind=ParameterKind.INT8),
    whole("ARSPD_USE", 1, 0, 2, "its reading is flown by", kind=ParameterKind.INT8),
    whole("WP_RADIUS", 30, 1, 32767, "a waypoint is reached so near, m", "acceptance_radius_m", kind=ParameterKind.INT16),
    whole("WP_LOITER_RAD", 80, -32767, 32767, "radius of circles, m; negative to the left", "wings.circle_m", kind=ParameterKind.INT16),
    whole("RTL_RADIUS", 0, -32767, 32767, "radius over home; 0 is WP_LOITER_RAD", "wings.return_circle_m", kind=ParameterKind.INT16),
    real("RTL_ALTITUDE", 60.0, -1.0, 1000.0, "height of returns, m; -1 keeps it", "wings.return_height_m"),
    whole("RTL_AUTOLAND", 0, 0, 4, "lands after a return: 0 circles", kind=ParameterKind.INT8),
    real("TKOFF_ALT", 50.0, 0.0, 200.0, "height of TAKEOFF, m", "wings.takeoff_height_m"),
    real("TKOFF_LVL_ALT", 10.0, 0.0, 50.0, "straight on below, m", "wings.takeoff_level_m"),
    real("TKOFF_LVL_PITCH", 12.0, 0.0, 30.0, "nose up, deg", "wings.takeoff_pitch_rad", radians(1.0)),
    real("TKOFF_ROTATE_SPD", 20.0, 0.0, 30.0, "air speed at which the nose is raised, m/s", "wings.takeoff_rotate_m_s"),
    real("TKOFF_DIST", 200.0, 0.0, 500.0, "circles so far ahead, m", "wings.takeoff_ahead_m"),
    real("AUTOLAND_WP_ALT", 25.0, 0.0, 200.0, "height at which the approach begins, m", "wings.approach_height_m"),
    real("AUTOLAND_WP_DIST", 400.0, 0.0, 700.0, "how far before home, m", "wings.approach_m"),
    real("TECS_LAND_ARSPD", 20.0, -1.0, 60.0, "air speed of approaches, m/s", "wings.approach_m_s"),
    real("LAND_FLARE_ALT", 3.0, 0.0, 30.0, "flare below, m", "wings.flare_m"),
    real("TECS_LAND_SINK", 0.4, 0.0, 2.0, "sink in the flare, m/s", "wings.flare_sink_m_s"),
    whole("LAND_DISARMDELAY", 2, 0, 127, "disarms after landing, s", "disarm_after_landing_s", kind=ParameterKind.INT8),
    # Control
    real("ROLL_LIMIT_DEG", 45.0, 0.0, 90.0, "largest bank, deg", "wings.roll_max_rad", radians(1.0)),
    real("PTCH_LIM_MAX_DEG", 20.0, 0.0, 90.0, "nose up, deg", "wings.pitch_max_rad", radians(1.0)),
    real("PTCH_LIM_MIN_DEG", -15.0, -90.0, 0.0, "nose down, deg", "wings.pitch_min_rad", radians(1.0)),
    real("SCALING_SPEED", 22.0, 0.0, 50.0, "air speed for which gains hold, m/s", "wings.scaling_m_s"),
    real("RLL2SRV_TCONST", 0.5, 0.4, 1.0, "time of roll, s", "wings.roll_s"),
    real("RLL_RATE_P", 0.2, 0.01, 2.0, "roll rate gain", "wings.roll_p"),
    real("RLL_RATE_I", 0.3, 0.0, 5.0, "roll rate integral gain", "wings.roll_i"),
    real("RLL_RATE_FF", 0.45, 0.0, 3.0, "roll rate feed-forward", "wings.roll_ff"),
    real("PTCH2SRV_TCONST", 0.4, 0.4, 1.0, "time of pitch, s", "wings.pitch_s"),
    real("PTCH_RATE_P", 0.8, 0.01, 2.0, "pitch rate gain", "wings.pitch_p"),
    real("PTCH_RATE_I", 1.5, 0.0, 5.0, "pitch rate integral gain", "wings.pitch_i"),
    real("PTCH_RATE_FF", 1.0, 0.0, 3.0, "pitch rate feed-forward", "wings.pitch_ff"),
    real("YAW2SRV_DAMP", 0.5, 0.0, 2.0, "yaw damping", "wings.yaw_damping"),
    real("GROUND_STEER_P", 2.0, 0.0, 10.0, "rudder per radian on the runway", "wings.steering_p"),
    real("NAVL1_PERIOD", 12.0, 1.0, 60.0, "period of guidance, s", "wings.guidance_s"),
    real("NAVL1_DAMPING", 0.75, 0.6, 1.0, "damping of guidance", "wings.guidance_damping"),
    whole("TRIM_THROTTLE", 66, 0, 100, "throttle of cruise, %", "wings.throttle_trim", kind=ParameterKind.INT8, scale=0.01),
    whole("THR_MAX", 100, 0, 100, "largest throttle, %", "wings.throttle_max", kind=ParameterKind.INT8, scale=0.01),
    real("TECS_CLMB_MAX", 5.0, 0.1, 20.0, "climb, m/s", "wings.climb_max_m_s"),
    real("TECS_SINK_MIN", 1.2, 0.1, 10.0, "sink without throttle, m/s", "wings.sink_min_m_s"),
    real("TECS_SINK_MAX", 4.0, 0.0, 20.0, "largest sink, m/s", "wings.sink_max_m_s"),
    real("TECS_TIME_CONST", 5.0, 3.0, 10.0, "time of height and speed, s", "wings.energy_s"),
    real("TECS_INTEG_GAIN", 0.1, 0.0, 0.5, "integral gain", "wings.energy_integral"),
    real("TECS_THR_DAMP", 0.5, 0.1, 1.0, "throttle damping", "wings.throttle_damping"),
    real("TECS_PTCH_DAMP", 0.3, 0.1, 1.0, "pitch damping", "wings.pitch_damping"),
)  # fmt: skip


def derive(request: Callable[[str], float], tuning: Tuning, long: Mapping[int, FailsafeAction] = LONG) -> None:
    """What follows from several parameters, or from the bits and choices of one.

    Args:
        request: gives the value of a parameter.
        tuning: is set.
        long: the actions of FS_LONG_ACTN.
    """
    station = int(request("FS_GCS_ENABL"))
    action = long[int(request("FS_LONG_ACTN"))]
    tuning.station_lost_action = action if station else FailsafeAction.NONE
    tuning.pilot_lost_action = action if request("THR_FAILSAFE") == 1 else FailsafeAction.NONE
    tuning.station_lost_exempt = Exempt.MISSION if station == 3 else 0
    tuning.action_delay_s = 0.0
    tuning.pilot_override = 0
    tuning.battery_emergency = 0.0
    tuning.position_lost_action = FailsafeAction.WARN
    capacity = max(1.0, request("BATT_CAPACITY"))
    tuning.battery_low, tuning.battery_critical = request("BATT_LOW_MAH") / capacity, request("BATT_CRT_MAH") / capacity
    kinds = int(request("FENCE_TYPE"))
    tuning.fence_height_m = request("FENCE_ALT_MAX") if kinds & 1 else 0.0
    tuning.fence_radius_m = request("FENCE_RADIUS") if kinds & 2 else 0.0
    tuning.fence_has_polygons = bool(kinds & 4)
    tuning.check_mask = -1 if request("ARMING_CHECK") else 0
    tuning.limits.speed_xy_m_s = request("AIRSPEED_CRUISE")
    tuning.gains.speed_xy_m_s = request("AIRSPEED_MAX")
    tuning.disarm_idle_s = -1.0
    tuning.disarm_unflown_s = 0.0
