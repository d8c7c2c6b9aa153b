"""Messages sent to PX4 over its simulator interface (MAVLink common, HIL_*)."""

from math import atan2, degrees, hypot
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.frames import GRAVITY_M_S2
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.barometer import pressure_pa
from gloc3_sitl.sensors.readings import (
    BarometerReading,
    FixKind,
    FixReading,
    ImuReading,
    MagnetometerReading,
    RangeReading,
)

ACCELEROMETER: Final = 0b111
"""Bits of `fields_updated`; PX4 uses a group of fields only if all its bits are set."""
GYRO: Final = 0b111 << 3
MAGNETOMETER: Final = 0b111 << 6
BAROMETER: Final = 1 << 9 | 1 << 11 | 1 << 12
"""Absolute pressure, pressure altitude, temperature."""

_GAUSS_PER_TESLA: Final = 1e4
_HPA_PER_PA: Final = 0.01
_SEA_LEVEL_C: Final = 15.0
_LAPSE_C_PER_M: Final = 0.0065
_NO_SIGNAL: Final = 1
_DOWN: Final = 25
_UNKNOWN_16: Final = 65535


def hil_sensor(
    t_s: float,
    imu: ImuReading,
    magnetometer: MagnetometerReading | None,
    barometer: BarometerReading | None,
    fields_updated: int,
) -> MavlinkMessage:
    """HIL_SENSOR; `fields_updated` marks the new fields."""
    (ax, ay, az), (p, q, r) = imu.specific_force_frd_m_s2, imu.rate_frd_rad_s
    mx, my, mz = (0.0, 0.0, 0.0) if magnetometer is None else magnetometer.field_frd_tesla
    altitude_m = 0.0 if barometer is None else barometer.altitude_m
    return codec.message(
        "HIL_SENSOR",
        time_usec=round(t_s * 1e6),
        xacc=ax,
        yacc=ay,
        zacc=az,
        xgyro=p,
        ygyro=q,
        zgyro=r,
        xmag=mx * _GAUSS_PER_TESLA,
        ymag=my * _GAUSS_PER_TESLA,
        zmag=mz * _GAUSS_PER_TESLA,
        abs_pressure=(pressure_pa(0.0) if barometer is None else barometer.pressure_pa) * _HPA_PER_PA,
        pressure_alt=altitude_m,
        temperature=_SEA_LEVEL_C - _LAPSE_C_PER_M * altitude_m,
        fields_updated=fields_updated,
    )


def hil_gps(fix: FixReading, utc_offset_s: float) -> MavlinkMessage:
    """HIL_GPS; its time is UTC, as from a receiver."""
    north, east, down = fix.velocity_ned_m_s
    speed_m_s = hypot(north, east)
    has_fix = fix.kind is not FixKind.NONE
    return codec.message(
        "HIL_GPS",
        time_usec=round((fix.t_s + utc_offset_s) * 1e6),
        fix_type=int(fix.kind),
        lat=round(fix.latitude_deg * 1e7) if has_fix else 0,
        lon=round(fix.longitude_deg * 1e7) if has_fix else 0,
        alt=round(fix.altitude_m * 1e3) if has_fix else 0,
        eph=max(1, round(fix.horizontal_accuracy_m * 100.0)) if has_fix else _UNKNOWN_16,
        epv=max(1, round(fix.vertical_accuracy_m * 100.0)) if has_fix else _UNKNOWN_16,
        vel=round(speed_m_s * 100.0) if has_fix else _UNKNOWN_16,
        vn=round(north * 100.0) if has_fix else 0,
        ve=round(east * 100.0) if has_fix else 0,
        vd=round(down * 100.0) if has_fix else 0,
        cog=round(degrees(atan2(east, north)) % 360.0 * 100.0) % 36000 if has_fix else _UNKNOWN_16,
        satellites_visible=fix.satellites if has_fix else 0,
    )


def distance_sensor(reading: RangeReading) -> MavlinkMessage:
    """DISTANCE_SENSOR, looking down; without an echo it is farther than its maximum, and of no quality."""
    most_cm = round(reading.max_m * 100.0)
    return codec.message(
        "DISTANCE_SENSOR",
        time_boot_ms=round(reading.t_s * 1e3),
        min_distance=round(reading.min_m * 100.0),
        max_distance=most_cm,
        current_distance=round(reading.distance_m * 100.0) if reading.is_valid else most_cm + 1,
        orientation=_DOWN,
        signal_quality=100 if reading.is_valid else _NO_SIGNAL,
    )


def hil_state(truth: Truth) -> MavlinkMessage:
    """HIL_STATE_QUATERNION: the truth, which PX4 only logs."""
    north, east, down = truth.velocity_ned_m_s
    p, q, r = truth.rate_frd_rad_s
    milli_g = [round(force / GRAVITY_M_S2 * 1e3) for force in truth.specific_force_frd_m_s2]
    speed_cm_s = round(hypot(*(v - w for v, w in zip(truth.velocity_ned_m_s, truth.wind_ned_m_s, strict=True))) * 100.0)
    return codec.message(
        "HIL_STATE_QUATERNION",
        time_usec=round(truth.t_s * 1e6),
        attitude_quaternion=list(truth.attitude_wxyz),
        rollspeed=p,
        pitchspeed=q,
        yawspeed=r,
        lat=round(truth.latitude_deg * 1e7),
        lon=round(truth.longitude_deg * 1e7),
        alt=round(truth.altitude_m * 1e3),
        vx=round(north * 100.0),
        vy=round(east * 100.0),
        vz=round(down * 100.0),
        ind_airspeed=speed_cm_s,
        true_airspeed=speed_cm_s,
        xacc=milli_g[0],
        yacc=milli_g[1],
        zacc=milli_g[2],
    )
