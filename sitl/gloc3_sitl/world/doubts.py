"""What is wrong in a world file that its schema cannot see: names of nothing, boxes inside out, things in one another."""

from itertools import combinations
from typing import Final

from gloc3.documents.document import Document
from gloc3.errors import Finding, nearest
from gloc3_sitl.world.model import Box, Surface, WorldFile
from gloc3_sitl.world.polygon import Plane, Polygon, clip_all

_TOUCH_M: Final = 1e-3
"""What reaches no deeper into something else only touches it."""


def doubts(document: Document, file: WorldFile) -> list[Finding]:
    """Everything that is wrong although each value by itself is allowed."""
    found = []
    if file.spawn.frame not in file.frames:
        hint = nearest(file.spawn.frame, list(file.frames))
        found.append(document.finding(("spawn", "frame"), f"no frame named {file.spawn.frame!r}", hint))
    bearers: list[tuple[str, str, str]] = [("surfaces", name, row.texture) for name, row in file.surfaces.items()]
    bearers += [("boxes", name, row.texture) for name, row in file.boxes.items()]
    for section, name, texture in bearers:
        if texture not in file.textures:
            hint = nearest(texture, list(file.textures))
            found.append(document.finding((section, name, "texture"), f"no texture named {texture!r}", hint))
    for name, box in file.boxes.items():
        if not all(low < high for low, high in zip(box.min_m, box.max_m, strict=True)):
            found.append(document.finding(("boxes", name), "min_m must be less than max_m on each axis"))
    if not found:
        found += _crossings(document, file)
    return found


def _crossings(document: Document, file: WorldFile) -> list[Finding]:
    """Things that pass through one another at the start: then neither can be drawn before the other."""
    found = []
    for (name, box), (other, beside) in combinations(file.boxes.items(), 2):
        gaps = [
            max(a, b) - min(c, d) for a, b, c, d in zip(box.min_m, beside.min_m, box.max_m, beside.max_m, strict=True)
        ]
        if max(gaps) < -_TOUCH_M:
            found.append(document.finding(("boxes", other), f"it is partly inside the box {name}", "cut one in two"))
    for surface, row in file.surfaces.items():
        for name, box in file.boxes.items():
            if clip_all(_corners(row), _inside(box)):
                message = f"it passes through the box {name}"
                found.append(document.finding(("surfaces", surface), message, "cut it in two, beside the box"))
    return found


def _corners(surface: Surface) -> Polygon:
    (x, y, z), (ax, ay, az), (bx, by, bz) = surface.corner_m, surface.across_m, surface.down_m
    return [
        (x, y, z),
        (x + ax, y + ay, z + az),
        (x + ax + bx, y + ay + by, z + az + bz),
        (x + bx, y + by, z + bz),
    ]


def _inside(box: Box) -> list[Plane]:
    """The planes between which the inside of a box is."""
    (x0, y0, z0), (x1, y1, z1) = box.min_m, box.max_m
    return [
        (1.0, 0.0, 0.0, x0 + _TOUCH_M),
        (-1.0, 0.0, 0.0, _TOUCH_M - x1),
        (0.0, 1.0, 0.0, y0 + _TOUCH_M),
        (0.0, -1.0, 0.0, _TOUCH_M - y1),
        (0.0, 0.0, 1.0, z0 + _TOUCH_M),
        (0.0, 0.0, -1.0, _TOUCH_M - z1),
    ]
