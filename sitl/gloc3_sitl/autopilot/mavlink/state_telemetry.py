"""Telemetry of the autopilot's state, one producer for each message."""

from math import cos, nan, sin, sqrt
from typing import TYPE_CHECKING, Final

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage
from gloc3_sitl.autopilot.estimator.sources import AidingSource
from gloc3_sitl.autopilot.mavlink.units import boot_ms, microseconds, short
from gloc3_sitl.autopilot.modes import Behaviour, Landed

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot

_GYRO, _ACCELEROMETER, _MAGNETOMETER, _PRESSURE, _GPS = 1, 2, 4, 8, 32
_VISION, _LASER = 128, 256
_RATE_CONTROL, _ATTITUDE_CONTROL, _YAW_CONTROL, _HEIGHT_CONTROL, _POSITION_CONTROL = 1024, 2048, 4096, 8192, 16384
_MOTORS, _RECEIVER, _FENCE, _AHRS, _LOGGING, _BATTERY = 32768, 65536, 1048576, 2097152, 16777216, 33554432
_PREARM: Final = 268435456


def sys_status(autopilot: "Autopilot") -> MavlinkMessage:
    """SYS_STATUS, with the bits from which ground stations derive health and readiness."""
    estimator, craft = autopilot.estimator, autopilot.craft
    now_s = craft.now_s
    present = (
        _GYRO | _ACCELEROMETER | _MAGNETOMETER | _PRESSURE | _GPS | _LASER | _AHRS | _BATTERY | _PREARM | _LOGGING
    ) | (_RATE_CONTROL | _ATTITUDE_CONTROL | _YAW_CONTROL | _HEIGHT_CONTROL | _POSITION_CONTROL | _MOTORS | _FENCE)
    if estimator.sources & (AidingSource.EXTERNAL_POSITION | AidingSource.EXTERNAL_VELOCITY):
        present |= _VISION
    if craft.pilot.last_seen_s > 0.0:
        present |= _RECEIVER
    enabled = present
    if not estimator.sources & AidingSource.FIX:
        enabled &= ~_GPS
    health = present
    fence = autopilot.commander.fence
    if autopilot.commander.style.name == "ardupilot":  # PX4 tells the same of its fence, whatever it does
        present = present if fence.is_present(craft) else present & ~_FENCE
        enabled = enabled if fence.is_kept(craft) else enabled & ~_FENCE
        health = health & ~_FENCE if fence.breach(craft) else health
    if not estimator.is_aligned:
        health &= ~(_GYRO | _ACCELEROMETER | _AHRS)
    if not estimator.is_heading_good(now_s):
        health &= ~_MAGNETOMETER
    if not estimator.is_height_good(now_s):
        health &= ~_PRESSURE
    if now_s - estimator.fix_state.accepted_s > 1.0:
        health &= ~_GPS
    if now_s - estimator.external_state.accepted_s > 1.0:
        health &= ~_VISION
    if not estimator.is_position_good(now_s):
        health &= ~(_AHRS | _POSITION_CONTROL)
    if not autopilot.commander.has_pilot:
        health &= ~_RECEIVER
    # ArduPilot looks at the mode when it is told to arm, not before.
    counts_mode = autopilot.commander.style.name != "ardupilot"
    if not craft.is_armed and autopilot.commander.problems(counts_mode=counts_mode):
        health &= ~_PREARM
    battery = autopilot.battery
    return message(
        "SYS_STATUS",
        onboard_control_sensors_present=present,
        onboard_control_sensors_enabled=enabled,
        onboard_control_sensors_health=health,
        load=250,
        voltage_battery=65535 if battery is None else min(65534, round(battery.voltage_v * 1e3)),
        current_battery=-1 if battery is None else short(battery.current_a * 100.0),
        battery_remaining=-1 if battery is None else round(battery.remaining * 100.0),
    )


def battery_status(autopilot: "Autopilot") -> MavlinkMessage | None:
    """BATTERY_STATUS."""
    battery = autopilot.battery
    if battery is None:
        return None
    cells = round(min(battery.voltage_v * 1e3, 65534))
    share, tuning = battery.remaining, autopilot.tuning
    charge = (
        4
        if share < tuning.battery_emergency
        else 3
        if share < tuning.battery_critical
        else 2
        if share < tuning.battery_low
        else 1
    )
    return message(
        "BATTERY_STATUS",
        battery_function=1,
        type=1,
        temperature=32767,
        voltages=(cells, *(65535,) * 9),
        current_battery=short(battery.current_a * 100.0),
        current_consumed=round(battery.consumed_ah * 1e3),
        energy_consumed=-1,
        battery_remaining=round(share * 100.0),
        charge_state=charge,
    )


def _landed_state(autopilot: "Autopilot") -> Landed:
    """Where the vehicle is between ground and air."""
    craft = autopilot.craft
    if craft.is_grounded:
        return Landed.ON_GROUND
    match autopilot.commander.mode.behaviour:
        case Behaviour.TAKE_OFF:
            return Landed.TAKING_OFF
        case Behaviour.LAND:
            return Landed.LANDING
        case _:
            return Landed.IN_AIR


def extended_sys_state(autopilot: "Autopilot") -> MavlinkMessage:
    """EXTENDED_SYS_STATE."""
    landed = int(_landed_state(autopilot)) if autopilot.vehicle.reports_landed else 0
    vtol = autopilot.craft.vtol
    form = 0 if vtol is None else int(vtol.reported(autopilot.craft.now_s))
    return message("EXTENDED_SYS_STATE", vtol_state=form, landed_state=landed)


def remote_id_status(autopilot: "Autopilot") -> MavlinkMessage | None:
    """OPEN_DRONE_ID_ARM_STATUS of a Remote ID that needs the operator's position; None where it is switched off."""
    if not any(autopilot.parameters[name] for name in ("COM_ARM_ODID", "DID_ENABLE") if name in autopilot.parameters):
        return None
    error = "" if autopilot.craft.has_operator_place else "operator location missing"
    return message("OPEN_DRONE_ID_ARM_STATUS", status=int(bool(error)), error=error)


def home_position(autopilot: "Autopilot") -> MavlinkMessage | None:
    """HOME_POSITION; None without a home."""
    home = autopilot.craft.home
    if home is None:
        return None
    n, e, d = home.position_ned_m
    return message(
        "HOME_POSITION",
        latitude=round(home.place.latitude_deg * 1e7),
        longitude=round(home.place.longitude_deg * 1e7),
        altitude=round(home.place.altitude_m * 1e3),
        x=n,
        y=e,
        z=d,
        q=(cos(home.yaw_rad / 2.0), 0.0, 0.0, sin(home.yaw_rad / 2.0)),
        approach_x=nan,
        approach_y=nan,
        approach_z=nan,
        time_usec=microseconds(autopilot),
    )


def global_origin(autopilot: "Autopilot") -> MavlinkMessage | None:
    """GPS_GLOBAL_ORIGIN; None without an origin."""
    plane = autopilot.estimator.origin
    if plane is None:
        return None
    origin = plane.origin
    return message(
        "GPS_GLOBAL_ORIGIN",
        latitude=round(origin.latitude_deg * 1e7),
        longitude=round(origin.longitude_deg * 1e7),
        altitude=round(origin.altitude_m * 1e3),
        time_usec=microseconds(autopilot),
    )


def estimator_status(autopilot: "Autopilot") -> MavlinkMessage:
    """ESTIMATOR_STATUS (PX4)."""
    estimator, now_s = autopilot.estimator, autopilot.craft.now_s
    flags = 0
    if estimator.is_aligned:
        flags |= 1
    if estimator.is_position_good(now_s):
        flags |= 2 | 8 | (16 if estimator.place is not None else 0) | 256
    if estimator.is_height_good(now_s):
        flags |= 4 | 32
    if now_s - estimator.range_t_s < 1.0:
        flags |= 64
    if estimator.fix_state.refused_since_s is not None:
        flags |= 1024
    return message(
        "ESTIMATOR_STATUS",
        time_usec=microseconds(autopilot),
        flags=flags,
        vel_ratio=_ratio(estimator.fix_state.test_ratio),
        pos_horiz_ratio=_ratio(max(estimator.fix_state.test_ratio, estimator.external_state.test_ratio)),
        pos_vert_ratio=_ratio(estimator.height_state.test_ratio),
        mag_ratio=_ratio(estimator.heading_state.test_ratio),
        hagl_ratio=nan,
        tas_ratio=nan,
        pos_horiz_accuracy=estimator.horizontal_deviation_m,
        pos_vert_accuracy=estimator.vertical_deviation_m,
    )


def ekf_status(autopilot: "Autopilot") -> MavlinkMessage:
    """EKF_STATUS_REPORT (ArduPilot)."""
    estimator, now_s = autopilot.estimator, autopilot.craft.now_s
    flags = 0
    if estimator.is_aligned:
        flags |= 1
    if estimator.is_position_good(now_s):
        flags |= 2 | 8 | 256 | (16 | 512 if estimator.origin is not None else 0)
    else:
        flags |= 128
    if estimator.is_height_good(now_s):
        flags |= 4 | 32
    return message(
        "EKF_STATUS_REPORT",
        flags=flags,
        velocity_variance=_ratio(estimator.fix_state.test_ratio),
        pos_horiz_variance=_ratio(max(estimator.fix_state.test_ratio, estimator.external_state.test_ratio)),
        pos_vert_variance=_ratio(estimator.height_state.test_ratio),
        compass_variance=_ratio(estimator.heading_state.test_ratio),
    )


def mission_current(autopilot: "Autopilot") -> MavlinkMessage:
    """MISSION_CURRENT."""
    progress, count = autopilot.craft.mission, len(autopilot.plans.mission)
    return message(
        "MISSION_CURRENT",
        seq=progress.reported,
        total=count or 65535,
        mission_state=int(progress.state),
        mission_mode=1 if autopilot.commander.mode.behaviour is Behaviour.MISSION else 2,
    )


def fence_status(autopilot: "Autopilot") -> MavlinkMessage | None:
    """FENCE_STATUS; None without a fence."""
    tuning = autopilot.tuning
    if not tuning.fence_is_on or not (autopilot.plans.fence or tuning.fence_radius_m or tuning.fence_height_m):
        return None
    broken = autopilot.commander.fence.breach(autopilot.craft)
    return message(
        "FENCE_STATUS",
        breach_status=1 if broken else 0,
        breach_count=autopilot.commander.fence.breaches,
        breach_type=0 if not broken else 2 if "height" in broken else 3,
        breach_time=int(autopilot.commander.fence.breach_s * 1e3),
    )


def system_time(autopilot: "Autopilot") -> MavlinkMessage:
    """SYSTEM_TIME."""
    return message("SYSTEM_TIME", time_boot_ms=boot_ms(autopilot), time_unix_usec=autopilot.utc_us)


def _ratio(squared: float) -> float:
    """Innovation test ratio as reported: the root of the squared ratio, at most 10."""
    return min(10.0, sqrt(max(0.0, squared)))
