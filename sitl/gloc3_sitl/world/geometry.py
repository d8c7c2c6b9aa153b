"""The shape of a world: rays, distances and lines of sight against its rectangles and boxes. Numpy only.

All positions and directions are `[x, y, height]` in the world's frame; times are those of the simulation, which decide
where moving boxes are.
"""

from math import inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3
from gloc3_sitl.world.model import Box, WorldSurface

Floats = NDArray[np.float64]
_EDGE_M: Final = 1e-6
_BLIND_M: Final = 1e-9
_PARALLEL: Final = 1e-12


class Geometry:
    """Rectangles and boxes with ray casting and distance queries.

    Args:
        surfaces: rectangles.
        boxes: solid boxes; those with a `shuttle` move.
    """

    def __init__(self, surfaces: list[WorldSurface], boxes: list[Box]) -> None:
        self._corners = _array([surface.corner_m for surface in surfaces])
        across = _array([surface.across_m for surface in surfaces])
        down = _array([surface.down_m for surface in surfaces])
        self._lengths = np.stack([np.linalg.norm(across, axis=1), np.linalg.norm(down, axis=1)])
        self._across = across / self._lengths[0][:, None]
        self._down = down / self._lengths[1][:, None]
        self._normals = np.cross(self._across, self._down)
        self._boxes = boxes
        self._min, self._max = _array([box.min_m for box in boxes]), _array([box.max_m for box in boxes])
        self._moving = [index for index, box in enumerate(boxes) if box.shuttle is not None]
        self._rectangles = _rectangles(self._corners, self._normals, self._across, self._down, self._lengths)
        self._slabs = _slabs(self._min, self._max)

    def boxes_at(self, t_s: float) -> tuple[Floats, Floats]:
        """Least and greatest corners of all boxes at a time, each of shape `(n, 3)`."""
        if not self._moving:
            return self._min, self._max
        least, most = self._min.copy(), self._max.copy()
        for index in self._moving:
            offset = self._boxes[index].offset_m(t_s)
            least[index] += offset
            most[index] += offset
        return least, most

    def ranges(self, origins_m: Floats, directions: Floats, t_s: float) -> Floats:
        """Distance along each ray to its first hit; infinity for none.

        Args:
            origins_m: ray origins, shape `(n, 3)` or `(3,)` for one place.
            directions: unit vectors, shape `(n, 3)`.
            t_s: the time.
        """
        origins = np.broadcast_to(np.asarray(origins_m, float), directions.shape)
        return np.minimum(self._to_surfaces(origins, directions), self._to_boxes(origins, directions, t_s))

    def range_m(self, origin_m: Vector3, direction: Vector3, t_s: float) -> float:
        """The same for one ray, which costs a tenth alone."""
        x, y, z = origin_m
        dx, dy, dz = direction
        nearest = inf
        for nx, ny, nz, n0, ax, ay, az, a0, a_m, bx, by, bz, b0, b_m in self._rectangles:
            slope = dx * nx + dy * ny + dz * nz
            if slope == 0.0:
                continue
            reach = (n0 - x * nx - y * ny - z * nz) / slope
            if _BLIND_M < reach < nearest:
                px, py, pz = x + reach * dx, y + reach * dy, z + reach * dz
                across, down = px * ax + py * ay + pz * az - a0, px * bx + py * by + pz * bz - b0
                if -_EDGE_M <= across <= a_m + _EDGE_M and -_EDGE_M <= down <= b_m + _EDGE_M:
                    nearest = reach
        if self._boxes:
            slopes = [slope if abs(slope) >= _PARALLEL else _PARALLEL for slope in direction]
            for slab in _slabs(*self.boxes_at(t_s)) if self._moving else self._slabs:
                nearest = min(nearest, _to_box(slab, origin_m, slopes))
        return nearest

    def is_clear(self, origin_m: Vector3, targets_m: Floats, t_s: float) -> NDArray[np.bool_]:
        """Whether the line of sight to each target, shape `(n, 3)`, is clear."""
        along = np.asarray(targets_m, float) - np.array(origin_m)
        lengths = np.linalg.norm(along, axis=1)
        ranges = self.ranges(np.array(origin_m), along / np.maximum(lengths, _BLIND_M)[:, None], t_s)
        clear: NDArray[np.bool_] = ranges >= lengths - 1e-3
        return clear

    def clearance_m(self, point_m: Vector3, t_s: float) -> float:
        """Distance from a place to the nearest rectangle or box; 0 inside a box, infinity in an empty world."""
        return min(self.surface_clearance_m(point_m), self.box_clearance_m(point_m, t_s))

    def surface_clearance_m(self, point_m: Vector3) -> float:
        """Distance to the nearest rectangle."""
        if not len(self._corners):
            return float("inf")
        from_corner = np.array(point_m) - self._corners
        beyond = []
        for axes, lengths in ((self._across, self._lengths[0]), (self._down, self._lengths[1])):
            place = (from_corner * axes).sum(axis=1)
            beyond.append(place - np.clip(place, 0.0, lengths))
        off = (from_corner * self._normals).sum(axis=1)
        return float(np.sqrt(off**2 + beyond[0] ** 2 + beyond[1] ** 2).min())

    def box_clearance_m(self, point_m: Vector3, t_s: float) -> float:
        """Distance to the nearest box; 0 inside one."""
        least, most = self.boxes_at(t_s)
        if not len(least):
            return float("inf")
        point = np.array(point_m)
        return float(np.linalg.norm(np.maximum(np.maximum(least - point, point - most), 0.0), axis=1).min())

    def _to_surfaces(self, origins: Floats, directions: Floats) -> Floats:
        if not len(self._corners):
            return np.full(len(directions), np.inf)
        height = origins @ self._normals.T - (self._corners * self._normals).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = -height / (directions @ self._normals.T)
            inside = reach > _BLIND_M
            for axes, lengths in ((self._across, self._lengths[0]), (self._down, self._lengths[1])):
                begin = origins @ axes.T - (self._corners * axes).sum(axis=1)
                place = begin + reach * (directions @ axes.T)
                inside &= (place >= -_EDGE_M) & (place <= lengths + _EDGE_M)
        nearest: Floats = np.where(inside, reach, np.inf).min(axis=1)
        return nearest

    def _to_boxes(self, origins: Floats, directions: Floats, t_s: float) -> Floats:
        """By slabs (Kay and Kajiya 1986); from inside a box its wall is met."""
        least, most = self.boxes_at(t_s)
        if not len(least):
            return np.full(len(directions), np.inf)
        enter = np.full((len(directions), len(least)), -np.inf)
        leave = np.full((len(directions), len(least)), np.inf)
        for axis in range(3):
            slope = directions[:, axis, None]
            slope = 1.0 / np.where(np.abs(slope) < _PARALLEL, _PARALLEL, slope)
            near = (least[:, axis] - origins[:, axis, None]) * slope
            far = (most[:, axis] - origins[:, axis, None]) * slope
            np.maximum(enter, np.minimum(near, far), out=enter)
            np.minimum(leave, np.maximum(near, far), out=leave)
        reach = np.where(enter > _BLIND_M, enter, leave)
        nearest: Floats = np.where((leave >= enter) & (leave > _BLIND_M), reach, np.inf).min(axis=1)
        return nearest


def _rectangles(corners: Floats, normals: Floats, across: Floats, down: Floats, lengths: Floats) -> list[list[float]]:
    """Each as numbers: normal, its offset; the two axes, each with its offset and length."""
    parts = []
    for axes, more in ((normals, None), (across, lengths[0]), (down, lengths[1])):
        parts += [axes, (corners * axes).sum(axis=1)[:, None]]
        parts += [] if more is None else [more[:, None]]
    listed: list[list[float]] = np.hstack(parts).tolist()
    return listed


def _slabs(least: Floats, most: Floats) -> list[list[tuple[float, float]]]:
    """Each box as its least and greatest coordinate along each axis."""
    return [list(zip(low, high, strict=True)) for low, high in zip(least.tolist(), most.tolist(), strict=True)]


def _to_box(slab: list[tuple[float, float]], origin_m: Vector3, slopes: list[float]) -> float:
    enter, leave = -inf, inf
    for (low, high), begin, slope in zip(slab, origin_m, slopes, strict=True):
        near, far = (low - begin) / slope, (high - begin) / slope
        if far < near:
            near, far = far, near
        if near > enter:
            enter = near
        if far < leave:
            leave = far
        if leave < enter:
            return inf
    if leave <= _BLIND_M:
        return inf
    return enter if enter > _BLIND_M else leave


def _array(rows: list[Vector3]) -> Floats:
    return np.array(rows, float).reshape(-1, 3)
