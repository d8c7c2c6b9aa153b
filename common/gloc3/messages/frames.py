"""Frames and rotations: geodetic, NED and local frames, quaternions and angles, in plain floats.

| frame | axes | used for |
| --- | --- | --- |
| geo | latitude and longitude in degrees, altitude above mean sea level in metres | maps, autopilots |
| ned | north, east, down, tangent to the ellipsoid at a stated origin | the world |
| local | x along a stated bearing, y 90 degrees to its left, height up | missions |
| frd | forward, right, down | the vehicle's body |
| rdf | right, down, forward (the optical axis) | cameras |

Rotations are Hamilton quaternions `(w, x, y, z)` with w >= 0, named `ned_from_frd`:
`v_ned = rotate(ned_from_frd, v_frd)`. Scalars and tuples are used throughout: for three or four numbers they are several
times faster than arrays.
"""

from math import asin, atan2, copysign, cos, degrees, floor, hypot, pi, radians, sin, sqrt, tau
from typing import Final, NamedTuple

Vector3 = tuple[float, float, float]
"""Three components; the frame and unit are in the name of the value."""

Quaternion = tuple[float, float, float, float]
"""A rotation as `(w, x, y, z)`."""

IDENTITY: Final[Quaternion] = (1.0, 0.0, 0.0, 0.0)
"""The rotation that changes nothing."""

ENU_FROM_NED: Final[Quaternion] = (0.0, 0.5**0.5, 0.5**0.5, 0.0)
"""Half a turn about the axis midway between north and east: north becomes y, east x, and down minus z."""

GRAVITY_M_S2: Final = 9.80665
"""Standard gravity, also the unit *g*."""

WGS84_A_M: Final = 6_378_137.0
"""Semi-major axis of WGS84 (NGA.STND.0036, table 3.1), in metres."""

WGS84_F: Final = 1.0 / 298.257223563
"""Flattening of WGS84 (NGA.STND.0036, table 3.1)."""

_E2: Final = WGS84_F * (2.0 - WGS84_F)
_B_M: Final = WGS84_A_M * (1.0 - WGS84_F)
_EP2: Final = _E2 / (1.0 - _E2)


def wrap_pi(angle_rad: float) -> float:
    """Bring an angle into [-pi, pi)."""
    return angle_rad - tau * floor((angle_rad + pi) / tau)


def multiply(a_from_b: Quaternion, b_from_c: Quaternion) -> Quaternion:
    """Chain two rotations: `a_from_c`."""
    aw, ax, ay, az = a_from_b
    bw, bx, by, bz = b_from_c
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(a_from_b: Quaternion) -> Quaternion:
    """Turn a unit quaternion round: `b_from_a`."""
    w, x, y, z = a_from_b
    return (w, -x, -y, -z)


def normalize(quaternion: Quaternion) -> Quaternion:
    """Scale to unit length and choose the sign with w >= 0; a zero quaternion becomes the identity."""
    w, x, y, z = quaternion
    length = sqrt(w * w + x * x + y * y + z * z)
    if length == 0.0:
        return IDENTITY
    scale = copysign(1.0 / length, w)
    return (w * scale, x * scale, y * scale, z * scale)


def rotate(a_from_b: Quaternion, vector_b: Vector3) -> Vector3:
    """Express a vector of frame b in frame a."""
    w, x, y, z = a_from_b
    vx, vy, vz = vector_b
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return (vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx)


def rotate_back(a_from_b: Quaternion, vector_a: Vector3) -> Vector3:
    """Express a vector of frame a in frame b, with the same quaternion."""
    w, x, y, z = a_from_b
    return rotate((w, -x, -y, -z), vector_a)


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """`ned_from_frd` of the aerospace angles (turn by yaw, then pitch, then roll)."""
    cr, sr = cos(roll_rad / 2.0), sin(roll_rad / 2.0)
    cp, sp = cos(pitch_rad / 2.0), sin(pitch_rad / 2.0)
    cy, sy = cos(yaw_rad / 2.0), sin(yaw_rad / 2.0)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


def to_euler(ned_from_frd: Quaternion) -> Vector3:
    """`(roll_rad, pitch_rad, yaw_rad)`; at pitch of ±90 degrees only yaw minus or plus roll is defined."""
    w, x, y, z = ned_from_frd
    sine = 2.0 * (w * y - z * x)
    pitch = copysign(pi / 2.0, sine) if abs(sine) >= 1.0 else asin(sine)
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, pitch, atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def yaw_of(ned_from_frd: Quaternion) -> float:
    """Heading of the body's forward axis in radians, clockwise from north, in [-pi, pi]."""
    w, x, y, z = ned_from_frd
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def from_yaw(yaw_rad: float) -> Quaternion:
    """`ned_from_frd` of a level body with this heading."""
    half = wrap_pi(yaw_rad) / 2.0
    return (cos(half), 0.0, 0.0, sin(half))


def from_rotation_vector(rotation_rad: Vector3) -> Quaternion:
    """The turn about this axis by its length in radians (exponential map)."""
    x, y, z = rotation_rad
    angle = sqrt(x * x + y * y + z * z)
    scale = 0.5 if angle < 1e-9 else sin(angle / 2.0) / angle
    return normalize((cos(angle / 2.0), x * scale, y * scale, z * scale))


def to_rotation_vector(a_from_b: Quaternion) -> Vector3:
    """Rotation vector: axis times angle in radians, for the shorter rotation (logarithm map)."""
    w, x, y, z = normalize(a_from_b)
    length = sqrt(x * x + y * y + z * z)
    scale = 2.0 if length < 1e-9 else 2.0 * atan2(length, w) / length
    return (x * scale, y * scale, z * scale)


def interpolate(begin: Vector3, end: Vector3, share: float) -> Vector3:
    """Point on the line through two points; `share` is 0 at `begin` and 1 at `end`, and may lie outside that range."""
    (ax, ay, az), (bx, by, bz) = begin, end
    return (ax + (bx - ax) * share, ay + (by - ay) * share, az + (bz - az) * share)


def slerp(begin: Quaternion, end: Quaternion, share: float) -> Quaternion:
    """Rotation between two along the shorter arc, at a constant rate; `share` as in `interpolate`."""
    x, y, z = to_rotation_vector(multiply(conjugate(begin), end))
    return normalize(multiply(begin, from_rotation_vector((x * share, y * share, z * share))))


class GeoPoint(NamedTuple):
    """A position on Earth."""

    latitude_deg: float
    """Geodetic latitude on WGS84."""
    longitude_deg: float
    """Longitude, east positive."""
    altitude_m: float
    """Altitude above mean sea level, used as height above the ellipsoid (a 50 m undulation scales distances by 8e-6)."""


def ecef_from_geo(point: GeoPoint) -> Vector3:
    """Earth-centred, Earth-fixed coordinates in metres."""
    latitude, longitude, altitude = radians(point[0]), radians(point[1]), point[2]
    sine, cosine = sin(latitude), cos(latitude)
    normal = WGS84_A_M / sqrt(1.0 - _E2 * sine * sine)
    across = (normal + altitude) * cosine
    return across * cos(longitude), across * sin(longitude), (normal * (1.0 - _E2) + altitude) * sine


def geo_from_ecef(x_m: float, y_m: float, z_m: float) -> GeoPoint:
    """Geodetic coordinates by Bowring's formula (Survey Review 23, 1976), twice: below a micrometre up to 100 km."""
    across = hypot(x_m, y_m)
    parametric = atan2(z_m * WGS84_A_M, across * _B_M)
    latitude = 0.0
    for _ in range(2):
        sine, cosine = sin(parametric), cos(parametric)
        latitude = atan2(z_m + _EP2 * _B_M * sine**3, across - _E2 * WGS84_A_M * cosine**3)
        parametric = atan2((1.0 - WGS84_F) * sin(latitude), cos(latitude))
    sine, cosine = sin(latitude), cos(latitude)
    altitude = across * cosine + z_m * sine - WGS84_A_M * sqrt(1.0 - _E2 * sine * sine)
    return GeoPoint(degrees(latitude), degrees(atan2(y_m, x_m)), altitude)


class TangentPlane:
    """North, east and down at an origin, converted exactly (through ECEF) in about 2 microseconds.

    The plane is flat and the Earth is not: at 300 m from the origin "down = 0" is 7 mm above the altitude of the
    origin, at 1 km 78 mm, at 3 km 0.7 m.
    """

    __slots__ = ("_cos_latitude", "_cos_longitude", "_origin_ecef_m", "_sin_latitude", "_sin_longitude", "origin")

    def __init__(self, origin: GeoPoint) -> None:
        self.origin: Final = GeoPoint(*origin)
        latitude, longitude = radians(origin[0]), radians(origin[1])
        self._origin_ecef_m = ecef_from_geo(self.origin)
        self._sin_latitude, self._cos_latitude = sin(latitude), cos(latitude)
        self._sin_longitude, self._cos_longitude = sin(longitude), cos(longitude)

    def __repr__(self) -> str:
        return f"TangentPlane({self.origin!r})"

    def ned_from_geo(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector3:
        """Position of a point on Earth in metres north, east and down of the origin."""
        return self.ned_from_ecef(*ecef_from_geo(GeoPoint(latitude_deg, longitude_deg, altitude_m)))

    def ned_from_ecef(self, x_m: float, y_m: float, z_m: float) -> Vector3:
        """Position of Earth-centred, Earth-fixed coordinates in metres north, east and down of the origin."""
        ox, oy, oz = self._origin_ecef_m
        x, y, z = x_m - ox, y_m - oy, z_m - oz
        outward = x * self._cos_longitude + y * self._sin_longitude
        return (
            z * self._cos_latitude - outward * self._sin_latitude,
            y * self._cos_longitude - x * self._sin_longitude,
            -(outward * self._cos_latitude + z * self._sin_latitude),
        )

    def geo_from_ned(self, position_ned_m: Vector3) -> GeoPoint:
        """Geographic point of a position in metres north, east and down of the origin."""
        north, east, down = position_ned_m
        outward = -north * self._sin_latitude - down * self._cos_latitude
        ox, oy, oz = self._origin_ecef_m
        return geo_from_ecef(
            ox + outward * self._cos_longitude - east * self._sin_longitude,
            oy + outward * self._sin_longitude + east * self._cos_longitude,
            oz + north * self._cos_latitude - down * self._sin_latitude,
        )


class LocalFrame:
    """A mission's frame: an origin on Earth, x along a bearing, y to the left of x, height up.

    All NED here refers to the tangent plane at the frame's own origin.
    """

    __slots__ = ("_cosine", "_sine", "plane", "x_axis_bearing_deg")

    def __init__(self, origin: GeoPoint, x_axis_bearing_deg: float = 0.0) -> None:
        self.plane: Final = TangentPlane(origin)
        self.x_axis_bearing_deg: Final = x_axis_bearing_deg
        self._cosine = cos(radians(x_axis_bearing_deg))
        self._sine = sin(radians(x_axis_bearing_deg))

    def __repr__(self) -> str:
        return f"LocalFrame({self.origin!r}, {self.x_axis_bearing_deg!r})"

    @property
    def origin(self) -> GeoPoint:
        """Geographic position of `(0, 0, 0)`."""
        return self.plane.origin

    def to_ned(self, position_m: Vector3) -> Vector3:
        """NED of a local position `(x, y, height)`; velocities and directions convert the same way."""
        x, y, height = position_m
        return (x * self._cosine + y * self._sine, x * self._sine - y * self._cosine, -height)

    def from_ned(self, position_ned_m: Vector3) -> Vector3:
        """Local `(x, y, height)` of a NED position; velocities and directions convert the same way."""
        north, east, down = position_ned_m
        return (north * self._cosine + east * self._sine, north * self._sine - east * self._cosine, -down)

    def to_geo(self, position_m: Vector3) -> GeoPoint:
        """Geographic position of a local position `(x, y, height)`."""
        return self.plane.geo_from_ned(self.to_ned(position_m))

    def from_geo(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector3:
        """Local `(x, y, height)` of a geographic position."""
        return self.from_ned(self.plane.ned_from_geo(latitude_deg, longitude_deg, altitude_m))
