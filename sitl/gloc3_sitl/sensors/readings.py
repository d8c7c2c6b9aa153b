"""Readings of the simulated sensors, one type for each sensor, with their times of validity."""

from enum import IntEnum

import msgspec

from gloc3.messages.frames import Vector3


class FixKind(IntEnum):
    """Quality of a fix, with the numbers of MAVLink's GPS_FIX_TYPE."""

    NONE = 1
    THREE_D = 3
    RTK_FIXED = 6


class ImuReading(msgspec.Struct, frozen=True, kw_only=True):
    """One sample of the accelerometers and gyros, in the body frame."""

    t_s: float
    """Time of validity."""
    specific_force_frd_m_s2: Vector3
    """Acceleration less gravity: about (0, 0, -9.8) at rest."""
    rate_frd_rad_s: Vector3
    """Turn rate."""


class BarometerReading(msgspec.Struct, frozen=True, kw_only=True):
    """Static pressure of the air."""

    t_s: float
    """Time of validity."""
    pressure_pa: float
    """Absolute pressure."""
    altitude_m: float
    """Altitude of this pressure in the ISO 2533 standard atmosphere, some metres off the true one."""


class MagnetometerReading(msgspec.Struct, frozen=True, kw_only=True):
    """The magnetic field in the body frame."""

    t_s: float
    """Time of validity."""
    field_frd_tesla: Vector3
    """Field strength; about 5e-5 in all."""


class RangeReading(msgspec.Struct, frozen=True, kw_only=True):
    """Distance to the ground along the body's down axis."""

    t_s: float
    """Time of validity."""
    distance_m: float
    """From the sensor to the surface; 0 where there is no echo."""
    is_valid: bool
    """Whether there was an echo within the range of the sensor."""
    min_m: float
    """Shortest measurable distance, m."""
    max_m: float
    """Longest measurable distance, m."""
    mount_height_m: float
    """Height of the sensor over the ground when the vehicle stands level, m; subtract it for the vehicle's height."""


class FixReading(msgspec.Struct, frozen=True, kw_only=True):
    """Position and velocity from satellites; it arrives later than it was true."""

    t_s: float
    """Time of validity, the receiver's latency ago."""
    kind: FixKind
    """Quality; position and velocity mean nothing with `NONE`."""
    latitude_deg: float
    """Geodetic latitude (WGS84)."""
    longitude_deg: float
    """Longitude (WGS84)."""
    altitude_m: float
    """Altitude above mean sea level."""
    velocity_ned_m_s: Vector3
    """Velocity over ground."""
    horizontal_accuracy_m: float
    """Standard deviation that the receiver claims, each of north and east."""
    vertical_accuracy_m: float
    """Standard deviation that the receiver claims."""
    speed_accuracy_m_s: float
    """Standard deviation that the receiver claims, each axis."""
    satellites: int
    """Satellites used."""


class BatteryReading(msgspec.Struct, frozen=True, kw_only=True):
    """State of the battery, as a power module reports it."""

    t_s: float
    """Time of validity."""
    voltage_v: float
    """At the terminals, under load."""
    current_a: float
    """Drawn now."""
    consumed_ah: float
    """Charge drawn since the start."""
    remaining: float
    """Share of the nominal charge that is left, 1 to 0."""


class WheelReading(msgspec.Struct, frozen=True, kw_only=True):
    """Distances that wheels have turned since the start."""

    t_s: float
    """Time of validity."""
    distances_m: tuple[float, float]
    """Way of the rim, left and right; backwards counts down."""


class AirspeedReading(msgspec.Struct, frozen=True, kw_only=True):
    """A reading of a pitot tube."""

    t_s: float
    """Time of validity."""
    airspeed_m_s: float
    """Indicated: as in air of 1.225 kg/m^3."""


class LeakReading(msgspec.Struct, frozen=True, kw_only=True):
    """Presence of water in the hull."""

    t_s: float
    """Time of validity."""
    is_wet: bool


Reading = (
    ImuReading
    | BarometerReading
    | MagnetometerReading
    | RangeReading
    | FixReading
    | BatteryReading
    | WheelReading
    | LeakReading
    | AirspeedReading
)
"""Any sensor's reading."""
