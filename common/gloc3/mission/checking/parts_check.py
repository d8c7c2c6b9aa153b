"""Checks fences and rally points of other programs that come without a mission."""

from collections.abc import Iterator

from gloc3.amounts import excess
from gloc3.errors import Finding
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.mission.formats.items import FenceArea, ForeignPlan
from gloc3.mission.model.fence import Area, Fence, polygon_problem

WIDEST_M = 1_000_000.0
"""A fence that is wider has corners that were swapped or mistyped."""


def parts_findings(plan: ForeignPlan, file: str) -> Iterator[Finding]:
    """What is wrong with a fence or with rally points; heights are not judged."""
    first = next((corner for area in plan.fence for corner in (*area.polygon, area.center) if corner is not None), None)
    if first is None:
        first = plan.rally[0][:2] if plan.rally else (0.0, 0.0)
    plane = TangentPlane(GeoPoint(*first, 0.0))
    areas = [_area(area, plane) for area in plan.fence]
    for number, (area, written) in enumerate(zip(areas, plan.fence, strict=True), start=1):
        problem = polygon_problem(area.polygon_ne_m) if written.polygon else ""
        if problem:
            yield Finding(file=file, message=f"area {number} of the fence: {problem}", hint="draw it again")
        far_m = max((max(abs(n), abs(e)) for n, e in area.polygon_ne_m), default=0.0)
        if far_m > WIDEST_M:
            message = f"area {number} of the fence reaches {far_m / 1000.0:.0f} km from its first corner"
            yield Finding(file=file, message=message, hint="are latitude and longitude of a corner swapped?")
    inside = [area for area, written in zip(areas, plan.fence, strict=True) if written.is_inclusion]
    outside = [area for area, written in zip(areas, plan.fence, strict=True) if not written.is_inclusion]
    fence = Fence(area=inside[0] if inside else None, keep_out=tuple(outside))
    points = [(f"rally point {number}", point[:2]) for number, point in enumerate(plan.rally, start=1)]
    if plan.fence_return is not None:
        points.append(("the return point", plan.fence_return))
    for name, place in points if len(inside) <= 1 and plan.fence else ():
        north, east, _ = plane.ned_from_geo(*place, 0.0)
        clearance_m = fence.clearance_m((north, east, 0.0))
        if clearance_m < 0.0:
            message = f"{name} is {excess(-clearance_m)} m outside the fence"
            yield Finding(file=file, message=message, hint="move it inwards")


def _area(area: FenceArea, plane: TangentPlane) -> Area:
    if area.center is not None:
        north, east, _ = plane.ned_from_geo(*area.center, 0.0)
        return Area(center_ne_m=(north, east), radius_m=area.radius_m)
    corners = [plane.ned_from_geo(*corner, 0.0) for corner in area.polygon]
    return Area(polygon_ne_m=tuple((north, east) for north, east, _ in corners))
