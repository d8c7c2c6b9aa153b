"""A flight without physics: a smooth path through a world as a function of time, with IMU data."""

from itertools import pairwise
from math import atan2, ceil, dist, hypot, pi
from typing import Final

import numpy as np

from gloc3.messages.frames import (
    GRAVITY_M_S2,
    Quaternion,
    Vector3,
    conjugate,
    interpolate,
    multiply,
    normalize,
    rotate_back,
    to_rotation_vector,
)
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.world import World

_KNOT_S: Final = 0.8
_REST_KNOTS: Final = 4
_STANDING_M: Final = 0.0973
_RATE_STEP_S: Final = 1e-3


class SmoothFlight:
    """A smooth flight from rest to rest that tilts like a multirotor; heading along the path or fixed.

    The path is a uniform cubic B-spline: position, speed and acceleration are continuous, and corners are rounded.

    Args:
        world: scene of the flight.
        waypoints_m: places `[x, y, height]` of the standing point, at least two.
        speed_m_s: between the corners.
        yaw_rad: heading as an angle from x towards y; None for along the path.
    """

    def __init__(
        self, world: World, waypoints_m: list[Vector3], speed_m_s: float = 0.5, yaw_rad: float | None = None
    ) -> None:
        places = _spaced(waypoints_m, speed_m_s * _KNOT_S)
        self._knots: Floats = np.array([places[0]] * _REST_KNOTS + places + [places[-1]] * _REST_KNOTS)
        self._yaws = _headings(self._knots) if yaw_rad is None else np.full(len(self._knots), yaw_rad)
        self._frame = world.frame
        self._start_ned = world.frame.to_ned(world.spawn_m)
        self._ground = world.height_at
        self.duration_s: Final = (len(self._knots) - 3) * _KNOT_S
        """From rest to rest."""
        self.length_m: Final = float(
            np.linalg.norm(
                np.diff([self.place_m(0.1 * n) for n in range(int(10.0 * self.duration_s))], axis=0), axis=1
            ).sum()
        )
        """Length of the path, m."""

    def place_m(self, t_s: float) -> Vector3:
        """Where the standing point is, `[x, y, height]`."""
        x, y, height = _spline(self._knots, t_s, 0).tolist()
        return (x, y, height)

    def truth(self, t_s: float) -> Truth:
        """Everything about one instant; before the start and after the end it rests."""
        place = self.place_m(t_s)
        latitude, longitude, altitude = self._frame.to_geo(place)
        velocity, acceleration = (_spline(self._knots, t_s, order).tolist() for order in (1, 2))
        attitude = self._attitude(t_s)
        rate = _difference(self._attitude(t_s - _RATE_STEP_S), self._attitude(t_s + _RATE_STEP_S), 2.0 * _RATE_STEP_S)
        north, east, down = self._frame.to_ned((acceleration[0], acceleration[1], acceleration[2]))
        position = self._frame.to_ned(place)
        return Truth(
            t_s=t_s,
            position_ned_m=tuple(float(a - b) for a, b in zip(position, self._start_ned, strict=True)),  # type: ignore[arg-type] # three
            velocity_ned_m_s=self._frame.to_ned((velocity[0], velocity[1], velocity[2])),
            attitude_wxyz=attitude,
            rate_frd_rad_s=rate,
            specific_force_frd_m_s2=rotate_back(attitude, (north, east, down - GRAVITY_M_S2)),
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_m=altitude,
            height_above_ground_m=place[2] - self._ground(place[0], place[1], t_s, place[2]),
            standing_height_m=_STANDING_M,
            is_on_ground=False,
            power_w=0.0,
            wind_ned_m_s=(0.0, 0.0, 0.0),
        )

    def _attitude(self, t_s: float) -> Quaternion:
        """`ned_from_frd`: down against the felt force, forward along the heading."""
        x, y, up = _spline(self._knots, t_s, 2).tolist()
        force = np.array(self._frame.to_ned((x, y, up))) - (0.0, 0.0, GRAVITY_M_S2)
        down = -force / np.linalg.norm(force)
        yaw = float(_spline(self._yaws[:, None], t_s, 0)[0])
        ahead = np.array(self._frame.to_ned((float(np.cos(yaw)), float(np.sin(yaw)), 0.0)))
        right = np.cross(down, ahead)
        right /= np.linalg.norm(right)
        return _quaternion(np.column_stack([np.cross(right, down), right, down]))


def _spaced(waypoints_m: list[Vector3], step_m: float) -> list[Vector3]:
    """Places along straight lines, about `step_m` apart, all corners among them."""
    places = [waypoints_m[0]]
    for begin, end in pairwise(waypoints_m):
        count = max(1, ceil(dist(begin, end) / step_m))
        places += [interpolate(begin, end, (number + 1) / count) for number in range(count)]
    return places


def _headings(knots: Floats) -> Floats:
    """Heading along the path at each knot, unwrapped; at rest and on climbs that of the next moving knot."""
    steps = np.diff(knots[:, :2], axis=0)
    moving = [index for index, (dx, dy) in enumerate(steps) if hypot(dx, dy) > 1e-6]
    if not moving:
        return np.zeros(len(knots))
    found = [next((j for j in moving if j >= index), moving[-1]) for index in range(len(knots))]
    return np.unwrap([atan2(steps[j][1], steps[j][0]) for j in found], period=2.0 * pi)


def _spline(knots: Floats, t_s: float, order: int) -> Floats:
    """The uniform cubic B-spline through the neighbourhood of its knots, or its first or second derivative."""
    u = min(max(t_s / _KNOT_S, 0.0), len(knots) - 3.0 - 1e-9)
    index = int(u)
    f = u - index
    weights = (
        (
            (1.0 - f) ** 3 / 6.0,
            (3.0 * f**3 - 6.0 * f**2 + 4.0) / 6.0,
            (-3.0 * f**3 + 3.0 * f**2 + 3.0 * f + 1.0) / 6.0,
            f**3 / 6.0,
        ),
        (-((1.0 - f) ** 2) / 2.0, (9.0 * f**2 - 12.0 * f) / 6.0, (-9.0 * f**2 + 6.0 * f + 3.0) / 6.0, f**2 / 2.0),
        (1.0 - f, 3.0 * f - 2.0, 1.0 - 3.0 * f, f),
    )[order]
    value: Floats = np.array(weights) @ knots[index : index + 4] / _KNOT_S**order
    return value


def _difference(before: Quaternion, after: Quaternion, step_s: float) -> Vector3:
    """Turn rate on the body's axes between two attitudes, rad/s."""
    x, y, z = to_rotation_vector(multiply(conjugate(before), after))
    return (x / step_s, y / step_s, z / step_s)


def _quaternion(matrix: Floats) -> Quaternion:
    """Of a rotation matrix, by its largest part (Shepperd 1978)."""
    m = matrix
    squares = np.array([m.trace(), m[0, 0], m[1, 1], m[2, 2]])
    largest = int(squares.argmax())
    if largest == 0:
        parts = (1.0 + m.trace(), m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        vector = [0.0, 0.0, 0.0]
        vector[i], vector[j], vector[k] = 1.0 + m[i, i] - m[j, j] - m[k, k], m[j, i] + m[i, j], m[k, i] + m[i, k]
        parts = (m[k, j] - m[j, k], *vector)
    w, x, y, z = (float(part) for part in parts)
    return normalize((w, x, y, z))
