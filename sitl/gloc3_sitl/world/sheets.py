"""The rectangles of a world as arrays: corners at a time, and painter's order."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3
from gloc3_sitl.world.cloth import Cloth, cloth_of, cloth_of_marker, tint_cloth_of, tint_cloth_of_marker
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.model import Box, Marker, WorldSurface
from gloc3_sitl.world.texture import MARKER_CELLS
from gloc3_sitl.world.world import World, box_sides

_LIFT_M: Final = 1e-3
"""So much above its floor is the tag for the order of drawing."""
_TOLERANCE_M: Final = 1e-4


class Sheets:
    """All rectangles of a world.

    Args:
        world: scene.
        is_tint: whether their cloths are the colours without brightness, of three channels; else grey.
    """

    def __init__(self, world: World, *, is_tint: bool = False) -> None:
        textures = world.file.textures
        make, make_marker = (tint_cloth_of, tint_cloth_of_marker) if is_tint else (cloth_of, cloth_of_marker)
        self.channels: Final = (3,) if is_tint else ()
        """Last axis of a picture's shape."""
        rows: list[tuple[WorldSurface, Cloth, bool]] = [
            (surface, make(textures[surface.texture]), False) for surface in world.file.surfaces.values()
        ]
        self._moves: list[tuple[slice, Box]] = []
        for box in world.file.boxes.values():
            sides = box_sides(box)
            if box.shuttle is not None:
                self._moves.append((slice(len(rows), len(rows) + len(sides)), box))
            rows += [(side, make(textures[side.texture]), True) for side in sides]
        self.tag: Final = len(rows) if world.marker is not None else -1
        """Index of the tag; -1 without one."""
        if world.marker is not None:
            rows.append((_tag(world.marker), make_marker(world.marker), False))
        self.cloths: Final = [cloth for _, cloth, _ in rows]
        self.starts_m: Final = [_start_m(index) if is_box else (0.0, 0.0) for index, (_, _, is_box) in enumerate(rows)]
        """Offset of each sheet's upper left corner on its texture; no two boxes look alike."""
        self._is_box = np.array([is_box for _, _, is_box in rows])
        corner = np.array([surface.corner_m for surface, _, _ in rows], float).reshape(-1, 3)
        across = np.array([surface.across_m for surface, _, _ in rows], float).reshape(-1, 3)
        down = np.array([surface.down_m for surface, _, _ in rows], float).reshape(-1, 3)
        self._corners = np.stack([corner, corner + across, corner + across + down, corner + down], axis=1)
        self.across: Final = across / np.linalg.norm(across, axis=1, keepdims=True)
        """Unit vectors from the upper left corner to the right."""
        self.down: Final = down / np.linalg.norm(down, axis=1, keepdims=True)
        """Unit vectors from the upper left corner down."""
        self.normals: Final = np.cross(self.down, self.across)
        """Unit vectors towards the viewer of an unmirrored texture; outwards for a box."""

    def corners_at(self, t_s: float) -> Floats:
        """Corners at a time, shape `(n, 4, 3)`: upper left, upper right, lower right, lower left."""
        if not self._moves:
            return self._corners
        corners = self._corners.copy()
        for rows, box in self._moves:
            corners[rows] += box.offset_m(t_s)
        return corners

    def facing(self, corners_m: Floats, eye_m: Floats) -> NDArray[np.bool_]:
        """Which sheets can be seen from a place as far as they themselves are concerned: not the far sides of boxes."""
        sides = ((eye_m - corners_m[:, 0]) * self.normals).sum(axis=1)
        found: NDArray[np.bool_] = (sides > 0.0) | ~self._is_box
        return found

    def order(self, indices: NDArray[np.int64], corners_m: Floats, eye_m: Floats) -> list[int]:
        """Sorts sheets from back to front.

        One sheet lies behind another if the other is wholly on the eye's side of its plane, or if it is wholly beyond
        the other's plane (Newell, Newell and Sancha 1972). Where neither order is forced, the farther one comes first.
        """
        corners = corners_m[indices]
        lifted = corners.copy()
        lifted[indices == self.tag] += (0.0, 0.0, _LIFT_M)
        normals = self.normals[indices]
        heights = np.einsum("ik,jck->ijc", normals, lifted) - (normals * lifted[:, 0]).sum(axis=1)[:, None, None]
        eye_side = np.sign(((eye_m - lifted[:, 0]) * normals).sum(axis=1))
        heights *= eye_side[:, None, None]
        before = (heights > -_TOLERANCE_M).all(axis=2)
        beyond = (heights < _TOLERANCE_M).all(axis=2)
        may_precede = before | beyond.T
        must_precede = may_precede & ~may_precede.T
        distances = np.linalg.norm(corners.mean(axis=1) - eye_m, axis=1)
        left = np.argsort(-distances, kind="stable").tolist()
        waiting = must_precede.sum(axis=0)
        ordered: list[int] = []
        while left:
            pick = next((index for index in left if waiting[index] <= 0), left[0])
            left.remove(pick)
            waiting = waiting - must_precede[pick]
            ordered.append(int(indices[pick]))
        return ordered


def _start_m(index: int) -> tuple[float, float]:
    return (1.37 * index) % 7.0, (0.83 * index) % 5.0


def _tag(marker: Marker) -> WorldSurface:
    """The tag with its border, as a rectangle."""
    half_m = marker.size_m * MARKER_CELLS / 12.0
    x, y, height = marker.center_m
    corner: Vector3 = (x + half_m, y + half_m, height)
    return WorldSurface(
        corner_m=corner, across_m=(0.0, -2.0 * half_m, 0.0), down_m=(-2.0 * half_m, 0.0, 0.0), texture="marker"
    )
