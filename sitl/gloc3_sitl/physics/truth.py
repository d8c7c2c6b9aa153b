"""Ground truth of a simulated vehicle, for sensors and flight tests."""

from typing import Protocol

import msgspec

from gloc3.messages.frames import Quaternion, Vector3


class Truth(msgspec.Struct, frozen=True, kw_only=True):
    """Ground truth at one instant.

    Positions are those of the *standing point*: straight below the centre of gravity by as much as the centre is over
    the ground when the vehicle stands level. So height is 0 on the ground, while velocities and accelerations are those
    of the centre of gravity.
    """

    t_s: float
    """Seconds since the start of the simulation."""
    position_ned_m: Vector3
    """Metres north, east and down of the home, in the tangent plane of the home."""
    velocity_ned_m_s: Vector3
    """Velocity over ground along the vehicle's own north, east and down (within 2e-4 rad of the home's up to 1 km)."""
    attitude_wxyz: Quaternion
    """`ned_from_frd`."""
    rate_frd_rad_s: Vector3
    """Turn rate of the body against the Earth."""
    specific_force_frd_m_s2: Vector3
    """What an accelerometer in the centre of gravity feels: (0, 0, -9.8) at rest; held within ±16 g."""
    latitude_deg: float
    """Geodetic latitude (WGS84)."""
    longitude_deg: float
    """Longitude (WGS84)."""
    altitude_m: float
    """Altitude above mean sea level of the standing point."""
    height_above_ground_m: float
    """Height of the standing point over the ground under it."""
    standing_height_m: float
    """Height of the centre of gravity over the standing point."""
    is_on_ground: bool
    """Whether a foot or an arm touches the ground."""
    power_w: float
    """Power drawn from the battery."""
    wind_ned_m_s: Vector3
    """Velocity of the air at the vehicle, turbulence included."""
    wheels_m: tuple[float, ...] = ()
    """Way that the rim of each wheel with an encoder has turned, left before right; empty for vehicles without wheels."""

    def imu(self) -> tuple[Vector3, Vector3]:
        """Specific force in m/s^2 and turn rate in rad/s, both FRD."""
        return self.specific_force_frd_m_s2, self.rate_frd_rad_s

    def truth(self) -> "Truth":
        """Return itself, so that one instant can stand where a moving vehicle is expected."""
        return self


class TrueMotion(Protocol):
    """True motion for the sensors: of a simulated vehicle, or one instant of it."""

    def imu(self) -> tuple[Vector3, Vector3]:
        """Specific force in m/s^2 and turn rate in rad/s, both FRD."""
        ...

    def truth(self) -> Truth:
        """Everything about this instant."""
        ...
