"""What the autopilot tells about itself: one producer a message."""

from collections.abc import Callable
from math import atan2, cos, degrees, hypot, isfinite, nan, sqrt, tau
from typing import TYPE_CHECKING, Any, Final

from gloc3.link.codec import message
from gloc3.link.message import MavlinkMessage
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint
from gloc3_sitl.autopilot.estimator.estimator import Source
from gloc3_sitl.autopilot.modes import Behaviour, Landed

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot

Producer = Callable[["Autopilot"], MavlinkMessage | None]

_GYRO, _ACCELEROMETER, _MAGNETOMETER, _PRESSURE, _GPS = 1, 2, 4, 8, 32
_VISION, _LASER = 128, 256
_RATE_CONTROL, _ATTITUDE_CONTROL, _YAW_CONTROL, _HEIGHT_CONTROL, _POSITION_CONTROL = 1024, 2048, 4096, 8192, 16384
_MOTORS, _RECEIVER, _FENCE, _AHRS, _LOGGING, _BATTERY = 32768, 65536, 1048576, 2097152, 16777216, 33554432
_PREARM: Final = 268435456


def boot_ms(autopilot: "Autopilot") -> int:
    """Milliseconds since boot, as most messages carry them."""
    return int(autopilot.craft.now_s * 1000.0) & 0xFFFFFFFF


def _microseconds(autopilot: "Autopilot") -> int:
    return int(autopilot.craft.now_s * 1e6)


def attitude(autopilot: "Autopilot") -> MavlinkMessage:
    """ATTITUDE."""
    roll, pitch, yaw = autopilot.estimator.euler_rad
    p, q, r = autopilot.estimator.inertial.rate_frd_rad_s
    return message(
        "ATTITUDE",
        time_boot_ms=boot_ms(autopilot),
        roll=roll,
        pitch=pitch,
        yaw=yaw,
        rollspeed=p,
        pitchspeed=q,
        yawspeed=r,
    )


def attitude_quaternion(autopilot: "Autopilot") -> MavlinkMessage:
    """ATTITUDE_QUATERNION."""
    w, x, y, z = autopilot.estimator.inertial.ned_from_frd
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    p, q, r = autopilot.estimator.inertial.rate_frd_rad_s
    return message(
        "ATTITUDE_QUATERNION",
        time_boot_ms=boot_ms(autopilot),
        q1=w,
        q2=x,
        q3=y,
        q4=z,
        rollspeed=p,
        pitchspeed=q,
        yawspeed=r,
    )


def local_position(autopilot: "Autopilot") -> MavlinkMessage | None:
    """LOCAL_POSITION_NED; silent while there is no position."""
    estimator = autopilot.estimator
    if not estimator.is_position_good(autopilot.craft.now_s):
        return None
    n, e, d = estimator.inertial.position_ned_m
    vn, ve, vd = estimator.inertial.velocity_ned_m_s
    return message("LOCAL_POSITION_NED", time_boot_ms=boot_ms(autopilot), x=n, y=e, z=d, vx=vn, vy=ve, vz=vd)


def global_position(autopilot: "Autopilot") -> MavlinkMessage | None:
    """GLOBAL_POSITION_INT; silent while there is no global position."""
    estimator = autopilot.estimator
    place = estimator.place
    if place is None or not estimator.is_position_good(autopilot.craft.now_s):
        return None
    vn, ve, vd = estimator.inertial.velocity_ned_m_s
    return message(
        "GLOBAL_POSITION_INT",
        time_boot_ms=boot_ms(autopilot),
        lat=round(place.latitude_deg * 1e7),
        lon=round(place.longitude_deg * 1e7),
        alt=round(place.altitude_m * 1e3),
        relative_alt=round(autopilot.craft.height_over_home_m * 1e3),
        vx=_short(vn * 100.0),
        vy=_short(ve * 100.0),
        vz=_short(vd * 100.0),
        hdg=round(degrees(estimator.yaw_rad % tau) * 100.0) % 36000,
    )


def gps_raw(autopilot: "Autopilot") -> MavlinkMessage:
    """GPS_RAW_INT."""
    fix = autopilot.estimator.fix
    if fix is None:
        return message("GPS_RAW_INT", time_usec=_microseconds(autopilot), eph=65535, epv=65535, satellites_visible=255)
    vn, ve, _ = fix.velocity_ned_m_s
    speed = hypot(vn, ve)
    return message(
        "GPS_RAW_INT",
        time_usec=int(fix.t_s * 1e6) if fix.t_s > 0.0 else 0,
        fix_type=fix.fix_type,
        lat=round(fix.place.latitude_deg * 1e7),
        lon=round(fix.place.longitude_deg * 1e7),
        alt=round(fix.place.altitude_m * 1e3),
        eph=min(65535, round(fix.horizontal_accuracy_m * 100.0)),
        epv=min(65535, round(fix.vertical_accuracy_m * 100.0)),
        vel=min(65534, round(speed * 100.0)),
        cog=round(degrees(atan2(ve, vn) % tau) * 100.0) % 36000,
        satellites_visible=fix.satellites,
        alt_ellipsoid=round(fix.place.altitude_m * 1e3),
        h_acc=min(2**32 - 1, round(fix.horizontal_accuracy_m * 1e3)),
        v_acc=min(2**32 - 1, round(fix.vertical_accuracy_m * 1e3)),
        vel_acc=min(2**32 - 1, round(fix.speed_accuracy_m_s * 1e3)),
    )


def sys_status(autopilot: "Autopilot") -> MavlinkMessage:
    """SYS_STATUS, with the bits by which ground stations judge health and readiness."""
    estimator, craft = autopilot.estimator, autopilot.craft
    now_s = craft.now_s
    present = (
        _GYRO | _ACCELEROMETER | _MAGNETOMETER | _PRESSURE | _GPS | _LASER | _AHRS | _BATTERY | _PREARM | _LOGGING
    ) | (_RATE_CONTROL | _ATTITUDE_CONTROL | _YAW_CONTROL | _HEIGHT_CONTROL | _POSITION_CONTROL | _MOTORS | _FENCE)
    if estimator.sources & (Source.EXTERNAL_POSITION | Source.EXTERNAL_VELOCITY):
        present |= _VISION
    if craft.pilot.last_seen_s > 0.0:
        present |= _RECEIVER
    enabled = present
    if not estimator.sources & Source.FIX:
        enabled &= ~_GPS
    health = present
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
    if not craft.is_armed and autopilot.commander.problems():
        health &= ~_PREARM
    battery = autopilot.battery
    return message(
        "SYS_STATUS",
        onboard_control_sensors_present=present,
        onboard_control_sensors_enabled=enabled,
        onboard_control_sensors_health=health,
        load=250,
        voltage_battery=65535 if battery is None else min(65534, round(battery.voltage_v * 1e3)),
        current_battery=-1 if battery is None else _short(battery.current_a * 100.0),
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
        current_battery=_short(battery.current_a * 100.0),
        current_consumed=round(battery.consumed_ah * 1e3),
        energy_consumed=-1,
        battery_remaining=round(share * 100.0),
        charge_state=charge,
    )


def landed_state(autopilot: "Autopilot") -> Landed:
    """Where the vehicle is between ground and air."""
    craft = autopilot.craft
    if craft.is_landed:
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
    return message("EXTENDED_SYS_STATE", vtol_state=0, landed_state=int(landed_state(autopilot)))


def home_position(autopilot: "Autopilot") -> MavlinkMessage | None:
    """HOME_POSITION; silent while there is none."""
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
        q=(cos(home.yaw_rad / 2.0), 0.0, 0.0, sqrt(max(0.0, 1.0 - cos(home.yaw_rad / 2.0) ** 2))),
        approach_x=nan,
        approach_y=nan,
        approach_z=nan,
        time_usec=_microseconds(autopilot),
    )


def global_origin(autopilot: "Autopilot") -> MavlinkMessage | None:
    """GPS_GLOBAL_ORIGIN; silent while there is none."""
    plane = autopilot.estimator.origin
    if plane is None:
        return None
    origin = plane.origin
    return message(
        "GPS_GLOBAL_ORIGIN",
        latitude=round(origin.latitude_deg * 1e7),
        longitude=round(origin.longitude_deg * 1e7),
        altitude=round(origin.altitude_m * 1e3),
        time_usec=_microseconds(autopilot),
    )


def distance_sensor(autopilot: "Autopilot") -> MavlinkMessage | None:
    """DISTANCE_SENSOR, looking down; without an echo it says more than its maximum, as real ones do."""
    reading = autopilot.range
    if reading is None:
        return None
    far = round(reading.max_m * 100.0)
    return message(
        "DISTANCE_SENSOR",
        time_boot_ms=int(reading.t_s * 1e3),
        min_distance=round(reading.min_m * 100.0),
        max_distance=far,
        current_distance=round(reading.distance_m * 100.0) if reading.is_valid else far + 100,
        type=0,
        id_=1,
        orientation=25,
        covariance=255,
        signal_quality=100 if reading.is_valid else 1,
    )


def vfr_hud(autopilot: "Autopilot") -> MavlinkMessage:
    """VFR_HUD."""
    estimator = autopilot.estimator
    vn, ve, vd = estimator.inertial.velocity_ned_m_s
    place = estimator.place
    speed = hypot(vn, ve)
    return message(
        "VFR_HUD",
        airspeed=speed,
        groundspeed=speed,
        heading=round(degrees(estimator.yaw_rad % tau)) % 360,
        throttle=round(100.0 * max(0.0, min(1.0, autopilot.thrust))),
        alt=place.altitude_m if place is not None else -estimator.inertial.position_ned_m[2],
        climb=-vd,
    )


def altitude(autopilot: "Autopilot") -> MavlinkMessage:
    """ALTITUDE."""
    estimator = autopilot.estimator
    place = estimator.place
    return message(
        "ALTITUDE",
        time_usec=_microseconds(autopilot),
        altitude_monotonic=estimator.barometer_altitude_m,
        altitude_amsl=nan if place is None else place.altitude_m,
        altitude_local=-estimator.inertial.position_ned_m[2],
        altitude_relative=autopilot.craft.height_over_home_m,
        altitude_terrain=nan,
        bottom_clearance=estimator.height_above_ground_m,
    )


def estimator_status(autopilot: "Autopilot") -> MavlinkMessage:
    """ESTIMATOR_STATUS (PX4)."""
    estimator, now_s = autopilot.estimator, autopilot.craft.now_s
    flags = 0
    if estimator.is_aligned:
        flags |= 1
    if estimator.is_position_good(now_s):
        flags |= 2 | 8 | (16 if estimator.origin is not None else 0) | 256
    if estimator.is_height_good(now_s):
        flags |= 4 | 32
    if now_s - estimator.range_t_s < 1.0:
        flags |= 64
    if estimator.fix_state.refused_since_s is not None:
        flags |= 1024
    return message(
        "ESTIMATOR_STATUS",
        time_usec=_microseconds(autopilot),
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
        seq=progress.current,
        total=count or 65535,
        mission_state=int(progress.state),
        mission_mode=1 if autopilot.commander.mode.behaviour is Behaviour.MISSION else 2,
    )


def position_target(autopilot: "Autopilot") -> MavlinkMessage | None:
    """POSITION_TARGET_LOCAL_NED: what the position loop is asked for."""
    setpoint = autopilot.craft.last_setpoint
    if not isinstance(setpoint, MotionSetpoint) or setpoint.is_landed:
        return None
    values = (*setpoint.position_ned_m, *setpoint.velocity_ned_m_s, *setpoint.acceleration_ned_m_s2)
    mask = sum(1 << index for index, value in enumerate(values) if not isfinite(value))
    if not isfinite(setpoint.yaw_rad):
        mask |= 1024
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz")
    fields: dict[str, Any] = dict(zip(names, values, strict=True))
    return message(
        "POSITION_TARGET_LOCAL_NED",
        time_boot_ms=boot_ms(autopilot),
        coordinate_frame=1,
        type_mask=mask,
        yaw=setpoint.yaw_rad,
        yaw_rate=setpoint.yaw_rate_rad_s,
        **fields,
    )


def attitude_target(autopilot: "Autopilot") -> MavlinkMessage:
    """ATTITUDE_TARGET: what the attitude loop is asked for."""
    return message(
        "ATTITUDE_TARGET",
        time_boot_ms=boot_ms(autopilot),
        q=autopilot.wanted_attitude,
        thrust=autopilot.thrust,
    )


def fence_status(autopilot: "Autopilot") -> MavlinkMessage | None:
    """FENCE_STATUS; silent without a fence."""
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


def scaled_imu(autopilot: "Autopilot") -> MavlinkMessage | None:
    """SCALED_IMU."""
    imu = autopilot.imu
    if imu is None:
        return None
    fx, fy, fz = imu.specific_force_frd_m_s2
    p, q, r = imu.rate_frd_rad_s
    field = autopilot.magnetometer.field_frd_tesla if autopilot.magnetometer is not None else (0.0, 0.0, 0.0)
    return message(
        "SCALED_IMU",
        time_boot_ms=boot_ms(autopilot),
        xacc=_short(fx / 9.80665e-3),
        yacc=_short(fy / 9.80665e-3),
        zacc=_short(fz / 9.80665e-3),
        xgyro=_short(p * 1e3),
        ygyro=_short(q * 1e3),
        zgyro=_short(r * 1e3),
        xmag=_short(field[0] * 1e7),
        ymag=_short(field[1] * 1e7),
        zmag=_short(field[2] * 1e7),
    )


def highres_imu(autopilot: "Autopilot") -> MavlinkMessage | None:
    """HIGHRES_IMU."""
    imu = autopilot.imu
    if imu is None:
        return None
    fx, fy, fz = imu.specific_force_frd_m_s2
    p, q, r = imu.rate_frd_rad_s
    field = autopilot.magnetometer.field_frd_tesla if autopilot.magnetometer is not None else (0.0, 0.0, 0.0)
    barometer = autopilot.barometer
    return message(
        "HIGHRES_IMU",
        time_usec=_microseconds(autopilot),
        xacc=fx,
        yacc=fy,
        zacc=fz,
        xgyro=p,
        ygyro=q,
        zgyro=r,
        xmag=field[0] * 1e4,
        ymag=field[1] * 1e4,
        zmag=field[2] * 1e4,
        abs_pressure=0.0 if barometer is None else barometer.pressure_pa / 100.0,
        pressure_alt=0.0 if barometer is None else barometer.altitude_m,
        fields_updated=63 if barometer is None else 63 | 512 | 2048,
    )


def system_time(autopilot: "Autopilot") -> MavlinkMessage:
    """SYSTEM_TIME."""
    return message("SYSTEM_TIME", time_boot_ms=boot_ms(autopilot), time_unix_usec=autopilot.unix_us)


def _short(value: float) -> int:
    return max(-32768, min(32767, round(value)))


def _ratio(squared: float) -> float:
    """Innovation test ratios are told as the root of the squared one, at most 10."""
    return min(10.0, sqrt(max(0.0, squared)))


PRODUCERS: Final[dict[str, Producer]] = {
    "ALTITUDE": altitude,
    "ATTITUDE": attitude,
    "ATTITUDE_QUATERNION": attitude_quaternion,
    "ATTITUDE_TARGET": attitude_target,
    "BATTERY_STATUS": battery_status,
    "DISTANCE_SENSOR": distance_sensor,
    "EKF_STATUS_REPORT": ekf_status,
    "ESTIMATOR_STATUS": estimator_status,
    "EXTENDED_SYS_STATE": extended_sys_state,
    "FENCE_STATUS": fence_status,
    "GLOBAL_POSITION_INT": global_position,
    "GPS_GLOBAL_ORIGIN": global_origin,
    "GPS_RAW_INT": gps_raw,
    "HIGHRES_IMU": highres_imu,
    "HOME_POSITION": home_position,
    "LOCAL_POSITION_NED": local_position,
    "MISSION_CURRENT": mission_current,
    "POSITION_TARGET_LOCAL_NED": position_target,
    "SCALED_IMU": scaled_imu,
    "SYSTEM_TIME": system_time,
    "SYS_STATUS": sys_status,
    "VFR_HUD": vfr_hud,
}
"""By the name of the message; None means that there is nothing to tell now."""
