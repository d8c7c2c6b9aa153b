"""Wind: a steady vector and turbulence."""

from math import cos, radians, sin

import msgspec

from gloc3.messages.frames import Vector3


class Wind(msgspec.Struct, frozen=True, kw_only=True):
    """The air around the vehicle."""

    velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Velocity of the air, north, east and down (not where it comes from)."""
    gust_m_s: float = 0.0
    """Wind speed at 20 ft above ground that sets the strength of the turbulence (Dryden spectra, MIL-F-8785C low altitude
    model); 0 is smooth air. Below 3 m the standard deviation is about 0.2 of it along the wind, 0.1 of it vertically."""


CALM = Wind()
"""Still air."""


def gusty(speed_m_s: float, from_deg: float) -> Wind:
    """Turbulent wind of this mean speed that blows from this bearing (clockwise from north)."""
    bearing = radians(from_deg)
    return Wind(velocity_ned_m_s=(-speed_m_s * cos(bearing), -speed_m_s * sin(bearing), 0.0), gust_m_s=speed_m_s)
