"""A small ray caster: what a scanner sees between upright walls and above a floor."""

from collections.abc import Iterator, Sequence
from math import cos, pi, sin
from typing import NamedTuple

import numpy as np

from gloc3.messages.frames import from_euler, rotate
from gloc3.messages.perception import LaserScan
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Tilt

Wall = tuple[tuple[float, float], tuple[float, float]]


def box(north_m: float, east_m: float, length_m: float, width_m: float) -> list[Wall]:
    """The four walls of a room or a box, from its south-western corner."""
    a, b = (north_m, east_m), (north_m + length_m, east_m)
    c, d = (north_m + length_m, east_m + width_m), (north_m, east_m + width_m)
    return [(a, b), (b, c), (c, d), (d, a)]


HOLD = [*box(-3.0, -13.0, 24.0, 16.0), *box(6.0, -9.0, 1.5, 1.0), *box(14.0, -2.0, 0.8, 0.8)]
BARE_HOLD = box(-3.0, -13.0, 24.0, 16.0)
CORRIDOR: list[Wall] = [((-100.0, -1.2), (100.0, -1.2)), ((-100.0, 1.2), (100.0, 1.2))]


class Scanner(NamedTuple):
    """A scanner in the middle of the body."""

    walls: Sequence[Wall]
    beams: int = 360
    angle_min_rad: float = -pi
    angle_span_rad: float = 2.0 * pi
    range_max_m: float = 30.0
    noise_m: float = 0.01

    def scan(self, pose: Planar, random: np.random.Generator, tilt: Tilt | None = None) -> LaserScan:
        """One turn, all beams at once."""
        tilt = tilt or Tilt()
        step = self.angle_span_rad / self.beams
        angles = self.angle_min_rad + step * np.arange(self.beams)
        ned_from_frd = from_euler(tilt.roll_rad, tilt.pitch_rad, pose.yaw_rad)
        axes = np.array([rotate(ned_from_frd, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))])
        rays = np.column_stack((np.cos(angles), -np.sin(angles))) @ axes
        ranges = self._to_walls(pose, rays)
        if tilt.height_m is not None:
            with np.errstate(divide="ignore"):
                to_floor = np.where(rays[:, 2] > 0.0, tilt.height_m / rays[:, 2], np.inf)
            ranges = np.minimum(ranges, to_floor)
        ranges = ranges + random.normal(0.0, self.noise_m, self.beams)
        ranges = np.where(ranges < self.range_max_m, ranges, self.range_max_m)  # as many scanners say nothing
        return LaserScan(
            scanner="laser",
            angle_min_rad=self.angle_min_rad,
            angle_step_rad=step,
            range_min_m=0.05,
            range_max_m=self.range_max_m,
            ranges_m=ranges.astype("<f4").tobytes(),
        )

    def _to_walls(self, pose: Planar, rays: Array) -> Array:
        begin = np.array([wall[0] for wall in self.walls]) - (pose.x_m, pose.y_m)
        along = np.array([np.subtract(wall[1], wall[0]) for wall in self.walls])
        cross = rays[:, None, 0] * along[:, 1] - rays[:, None, 1] * along[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (begin[:, 0] * along[:, 1] - begin[:, 1] * along[:, 0]) / cross
            share = (begin[:, 0] * rays[:, None, 1] - begin[:, 1] * rays[:, None, 0]) / cross
        is_hit = (distance > 0.0) & (share >= 0.0) & (share <= 1.0)
        nearest: Array = np.where(is_hit, distance, np.inf).min(axis=1)
        return nearest


def flight(
    length_m: float = 60.0, speed_m_s: float = 0.8, rate_hz: float = 10.0
) -> Iterator[tuple[float, Planar, Tilt]]:
    """Time, pose and tilt on a way up and down along the walls of the hold, wobbling, with turns."""
    corners = [(0.0, 0.0), (17.0, 0.0), (17.0, -10.0), (0.0, -10.0)]
    t_s, made_m, side = 0.0, 0.0, 0
    at, yaw = np.array(corners[0]), 0.0
    while made_m < length_m:
        goal = np.array(corners[(side + 1) % 4])
        way = goal - at
        left_m = float(np.hypot(*way))
        if left_m < 0.05:
            side += 1
            continue
        step_m = min(speed_m_s / rate_hz, left_m)
        at = at + way / left_m * step_m
        wanted = float(np.arctan2(way[1], way[0]))
        yaw += float(np.clip((wanted - yaw + pi) % (2 * pi) - pi, -0.08, 0.08))
        made_m, t_s = made_m + step_m, t_s + 1.0 / rate_hz
        tilt = Tilt(0.09 * sin(1.3 * t_s), 0.07 * cos(0.9 * t_s), 1.8 + 0.4 * sin(0.2 * t_s))
        yield t_s, Planar(float(at[0]), float(at[1]), (yaw + pi) % (2 * pi) - pi), tilt
