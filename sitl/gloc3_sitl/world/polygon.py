"""Convex polygons in camera axes, clipped to the view; plain floats, which are faster here than arrays."""

from typing import Final

from gloc3.messages.frames import Vector3

Polygon = list[Vector3]
"""Corners in order."""
Plane = tuple[float, float, float, float]
"""`(nx, ny, nz, d)`: a point p is inside where n . p >= d."""

NEAR_M: Final = 0.02


def view_planes(left: float, top: float, right: float, bottom: float) -> list[Plane]:
    """Planes that bound the view of a pinhole camera, in camera axes (right, down, forward).

    Args:
        left: x / z of the picture's left border; the others likewise.
        top: y / z.
        right: x / z.
        bottom: y / z.
    """
    return [
        (0.0, 0.0, 1.0, NEAR_M),
        (1.0, 0.0, -left, 0.0),
        (-1.0, 0.0, right, 0.0),
        (0.0, 1.0, -top, 0.0),
        (0.0, -1.0, bottom, 0.0),
    ]


def clip(polygon: Polygon, plane: Plane) -> Polygon:
    """What of a polygon lies inside a plane (Sutherland and Hodgman 1974)."""
    nx, ny, nz, d = plane
    sides = [nx * x + ny * y + nz * z - d for x, y, z in polygon]
    if not sides or min(sides) >= 0.0:
        return polygon
    if max(sides) < 0.0:
        return []
    kept: Polygon = []
    last, last_side = polygon[-1], sides[-1]
    for point, side in zip(polygon, sides, strict=True):
        if (last_side >= 0.0) != (side >= 0.0):
            share = last_side / (last_side - side)
            (ax, ay, az), (bx, by, bz) = last, point
            kept.append((ax + (bx - ax) * share, ay + (by - ay) * share, az + (bz - az) * share))
        if side >= 0.0:
            kept.append(point)
        last, last_side = point, side
    return kept


def clip_all(polygon: Polygon, planes: list[Plane]) -> Polygon:
    """What lies inside all planes; empty if that is no area."""
    for plane in planes:
        polygon = clip(polygon, plane)
        if len(polygon) < 3:
            return []
    return polygon


def depth_bands(polygon: Polygon, ratio: float) -> list[Polygon]:
    """Cuts a polygon across the line of sight, so that in no part the farthest is more than `ratio` times the nearest."""
    depths = [z for _, _, z in polygon]
    nearest, farthest = min(depths), max(depths)
    bands: list[Polygon] = []
    while farthest > nearest * ratio * 1.2:
        nearest *= ratio
        bands.append(clip_all(polygon, [(0.0, 0.0, -1.0, -nearest)]))
        polygon = clip_all(polygon, [(0.0, 0.0, 1.0, nearest)])
    bands.append(polygon)
    return [band for band in bands if band]
