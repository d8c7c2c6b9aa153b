"""Telemetry of motion and sensors, one producer for each message."""

from math import atan2, degrees, hypot, isfinite, isnan, nan, tau
from typing import TYPE_CHECKING, Any, Final

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint
from gloc3_sitl.autopilot.mavlink.units import boot_ms, microseconds, milli_g, short
from gloc3_sitl.sensors.readings import ImuReading

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot


_DILUTION: Final = 14.0
"""Horizontal dilution of precision times the number of satellites, about; the vertical one is half as much again."""


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


def attitude_target(autopilot: "Autopilot") -> MavlinkMessage:
    """ATTITUDE_TARGET: setpoint of the attitude loop."""
    return message(
        "ATTITUDE_TARGET",
        time_boot_ms=boot_ms(autopilot),
        q=autopilot.control.wanted_attitude,
        thrust=autopilot.control.thrust,
    )


def local_position(autopilot: "Autopilot") -> MavlinkMessage | None:
    """LOCAL_POSITION_NED; None without a position."""
    estimator = autopilot.estimator
    if not estimator.is_position_good(autopilot.craft.now_s):
        return None
    n, e, d = estimator.inertial.position_ned_m
    vn, ve, vd = estimator.inertial.velocity_ned_m_s
    return message("LOCAL_POSITION_NED", time_boot_ms=boot_ms(autopilot), x=n, y=e, z=d, vx=vn, vy=ve, vz=vd)


def global_position(autopilot: "Autopilot") -> MavlinkMessage | None:
    """GLOBAL_POSITION_INT; None without a global position."""
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
        vx=short(vn * 100.0),
        vy=short(ve * 100.0),
        vz=short(vd * 100.0),
        hdg=round(degrees(estimator.yaw_rad % tau) * 100.0) % 36000,
    )


def position_target(autopilot: "Autopilot") -> MavlinkMessage | None:
    """POSITION_TARGET_LOCAL_NED: setpoint of the position loop."""
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


def gps_raw(autopilot: "Autopilot") -> MavlinkMessage:
    """GPS_RAW_INT."""
    fix = autopilot.estimator.fix
    if fix is None:
        return message("GPS_RAW_INT", time_usec=microseconds(autopilot), eph=65535, epv=65535, satellites_visible=255)
    vn, ve, _ = fix.velocity_ned_m_s
    speed = hypot(vn, ve)
    return message(
        "GPS_RAW_INT",
        time_usec=int(fix.t_s * 1e6) if fix.t_s > 0.0 else 0,
        fix_type=fix.fix_type,
        lat=round(fix.place.latitude_deg * 1e7),
        lon=round(fix.place.longitude_deg * 1e7),
        alt=round(fix.place.altitude_m * 1e3),
        eph=round(100.0 * _DILUTION / max(1, fix.satellites)),
        epv=round(150.0 * _DILUTION / max(1, fix.satellites)),
        vel=min(65534, round(speed * 100.0)),
        cog=round(degrees(atan2(ve, vn) % tau) * 100.0) % 36000,
        satellites_visible=fix.satellites,
        alt_ellipsoid=round(fix.place.altitude_m * 1e3),
        h_acc=min(2**32 - 1, round(fix.horizontal_accuracy_m * 1e3)),
        v_acc=min(2**32 - 1, round(fix.vertical_accuracy_m * 1e3)),
        vel_acc=min(2**32 - 1, round(fix.speed_accuracy_m_s * 1e3)),
    )


def vfr_hud(autopilot: "Autopilot") -> MavlinkMessage:
    """VFR_HUD."""
    estimator = autopilot.estimator
    vn, ve, vd = estimator.inertial.velocity_ned_m_s
    place = estimator.place
    speed = hypot(vn, ve)
    return message(
        "VFR_HUD",
        airspeed=speed if isnan(airspeed := autopilot.craft.airspeed_m_s) else airspeed,
        groundspeed=speed,
        heading=round(degrees(estimator.yaw_rad % tau)) % 360,
        throttle=round(100.0 * max(0.0, min(1.0, autopilot.control.thrust))),
        alt=place.altitude_m if place is not None else -estimator.inertial.position_ned_m[2],
        climb=-vd,
    )


def altitude(autopilot: "Autopilot") -> MavlinkMessage:
    """ALTITUDE."""
    estimator = autopilot.estimator
    place = estimator.place
    return message(
        "ALTITUDE",
        time_usec=microseconds(autopilot),
        altitude_monotonic=estimator.barometer_altitude_m,
        altitude_amsl=nan if place is None else place.altitude_m,
        altitude_local=-estimator.inertial.position_ned_m[2],
        altitude_relative=autopilot.craft.height_over_home_m,
        altitude_terrain=nan,
        bottom_clearance=estimator.height_above_ground_m,
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


OUTER_S: Final = 0.02
"""Period of the loop that sends."""


def imu_messages(name: str, autopilot: "Autopilot", rate_hz: float) -> list[MavlinkMessage]:
    """SCALED_IMU or HIGHRES_IMU at a rate above that of the outer loop: several, with the times of their readings."""
    recent = list(autopilot.imu_recent)
    if not recent:
        return []
    count = min(len(recent), max(1, round(rate_hz * OUTER_S)))
    make = scaled_imu if name == "SCALED_IMU" else highres_imu
    chosen = [recent[(index + 1) * len(recent) // count - 1] for index in range(count)]
    return [made for reading in chosen if (made := make(autopilot, reading)) is not None]


def scaled_imu(autopilot: "Autopilot", reading: ImuReading | None = None) -> MavlinkMessage | None:
    """SCALED_IMU, of a reading or of the last one."""
    imu = reading or autopilot.imu
    if imu is None:
        return None
    fx, fy, fz = imu.specific_force_frd_m_s2
    p, q, r = imu.rate_frd_rad_s
    field = autopilot.magnetometer.field_frd_tesla if autopilot.magnetometer is not None else (0.0, 0.0, 0.0)
    return message(
        "SCALED_IMU",
        time_boot_ms=int(imu.t_s * 1e3) & 0xFFFFFFFF,
        xacc=milli_g(fx),
        yacc=milli_g(fy),
        zacc=milli_g(fz),
        xgyro=short(p * 1e3),
        ygyro=short(q * 1e3),
        zgyro=short(r * 1e3),
        xmag=short(field[0] * 1e7),
        ymag=short(field[1] * 1e7),
        zmag=short(field[2] * 1e7),
    )


def highres_imu(autopilot: "Autopilot", reading: ImuReading | None = None) -> MavlinkMessage | None:
    """HIGHRES_IMU, of a reading or of the last one."""
    imu = reading or autopilot.imu
    if imu is None:
        return None
    fx, fy, fz = imu.specific_force_frd_m_s2
    p, q, r = imu.rate_frd_rad_s
    field = autopilot.magnetometer.field_frd_tesla if autopilot.magnetometer is not None else (0.0, 0.0, 0.0)
    barometer = autopilot.barometer
    return message(
        "HIGHRES_IMU",
        time_usec=int(imu.t_s * 1e6),
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
