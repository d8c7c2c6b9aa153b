"""The Earth's magnetic field at a place: the World Magnetic Model of 2020."""

from math import atan2, cos, degrees, hypot, radians, sin, sqrt
from typing import Final

from gloc3.messages.frames import GeoPoint, Vector3, ecef_from_geo

_REFERENCE_RADIUS_M: Final = 6_371_200.0

_G_NT: Final = (
    (-29404.5, -1450.7),
    (-2500.0, 2982.0, 1676.8),
    (1363.9, -2381.0, 1236.2, 525.7),
    (903.1, 809.4, 86.2, -309.4, 47.9),
    (-234.4, 363.1, 187.8, -140.7, -151.2, 13.7),
    (65.9, 65.6, 73.0, -121.5, -36.2, 13.5, -64.7),
    (80.6, -76.8, -8.3, 56.5, 15.8, 6.4, -7.2, 9.8),
    (23.6, 9.8, -17.5, -0.4, -21.1, 15.3, 13.7, -16.5, -0.3),
    (5.0, 8.2, 2.9, -1.4, -1.1, -13.3, 1.1, 8.9, -9.3, -11.9),
    (-1.9, -6.2, -0.1, 1.7, -0.9, 0.6, -0.9, 1.9, 1.4, -2.4, -3.9),
    (3.0, -1.4, -2.5, 2.4, -0.9, 0.3, -0.7, -0.1, 1.4, -0.6, 0.2, 3.1),
    (-2.0, -0.1, 0.5, 1.3, -1.2, 0.7, 0.3, 0.5, -0.2, -0.5, 0.1, -1.1, -0.3),
)
_H_NT: Final = (
    (0.0, 4652.9),
    (0.0, -2991.6, -734.8),
    (0.0, -82.2, 241.8, -542.9),
    (0.0, 282.0, -158.4, 199.8, -350.1),
    (0.0, 47.7, 208.4, -121.3, 32.2, 99.1),
    (0.0, -19.1, 25.0, 52.7, -64.4, 9.0, 68.1),
    (0.0, -51.4, -16.8, 2.3, 23.5, -2.2, -27.2, -1.9),
    (0.0, 8.4, -15.3, 12.8, -11.8, 14.9, 3.6, -6.9, 2.8),
    (0.0, -23.3, 11.1, 9.8, -5.1, -6.2, 7.8, 0.4, -1.5, 9.7),
    (0.0, 3.4, -0.2, 3.5, 4.8, -8.6, -0.1, -4.2, -3.4, -0.1, -8.8),
    (0.0, 0.0, 2.6, -0.5, -0.4, 0.6, -0.2, -1.7, -1.6, -3.0, -2.0, -2.6),
    (0.0, -1.2, 0.5, 1.3, -1.8, 0.1, 0.7, -0.1, 0.6, 0.2, -0.9, 0.0, 0.5),
)


def field_ned_tesla(place: GeoPoint) -> Vector3:
    """The field at the epoch 2020.0, north, east and down, in tesla.

    The coefficients are those of WMM2020 (NOAA NCEI and BGS, 2019, public domain), without secular variation.
    A vehicle's own table differs by some tenths of a degree, as on real ones.
    """
    x, y, z = ecef_from_geo(place)
    across = hypot(x, y)
    radius = hypot(across, z)
    sine, cosine = z / radius, max(across / radius, 1e-9)
    longitude = radians(place.longitude_deg)
    up = north = east = 0.0
    for n, (g_row, h_row) in enumerate(zip(_G_NT, _H_NT, strict=True), start=1):
        scale = (_REFERENCE_RADIUS_M / radius) ** (n + 2)
        for m in range(n + 1):
            along = g_row[m] * cos(m * longitude) + h_row[m] * sin(m * longitude)
            round_ = h_row[m] * cos(m * longitude) - g_row[m] * sin(m * longitude)
            value = _legendre(n, m, sine, cosine)
            slope = (
                (n + m) * sqrt((n - m) / (n + m)) * _legendre(n - 1, m, sine, cosine) if n > m else 0.0
            ) - n * sine * value
            up += scale * (n + 1) * along * value
            north -= scale * along * slope / cosine
            east -= scale * m * round_ * value / cosine
    # From the geocentric to the geodetic vertical.
    tilt = radians(place.latitude_deg) - atan2(z, across)
    return (
        (north * cos(tilt) - up * sin(tilt)) * 1e-9,
        east * 1e-9,
        -(north * sin(tilt) + up * cos(tilt)) * 1e-9,
    )


def declination_deg(place: GeoPoint) -> float:
    """Angle from true north to magnetic north, east positive."""
    north, east, _ = field_ned_tesla(place)
    return degrees(atan2(east, north))


def _legendre(n: int, m: int, sine: float, cosine: float) -> float:
    """Schmidt semi-normalised associated Legendre function of the sine of the geocentric latitude."""
    value = 1.0
    for k in range(1, m + 1):
        value *= cosine * (1.0 if k == 1 else sqrt((2 * k - 1) / (2 * k)))
    before = 0.0
    for k in range(m + 1, n + 1):
        value, before = (
            ((2 * k - 1) * sine * value - sqrt((k - 1) ** 2 - m * m) * before) / sqrt(k * k - m * m),
            value,
        )
    return value
