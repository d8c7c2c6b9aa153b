"""Reads the geofence of a mission file: areas as written in, areas in NED out."""

from gloc3.document import Document, Where
from gloc3.errors import Finding
from gloc3.mission.fence import Area, Fence, polygon_problem
from gloc3.mission.model import AreaFile, GeofenceFile
from gloc3.mission.placement import Placement, Point


def read_fence(geofence: GeofenceFile, placement: Placement, document: Document, findings: list[Finding]) -> Fence:
    """The fence in NED; what is wrong with it is appended to the findings."""
    area = _area(geofence, placement, ("geofence",), document, findings, is_needed=geofence.ceiling_m is None)
    keep_out = [
        _area(one, placement, ("geofence", "keep_out", index), document, findings)
        for index, one in enumerate(geofence.keep_out)
    ]
    ceiling_m = None if geofence.ceiling_m is None else placement.height_from(geofence.ceiling_m)
    return Fence(area=area, keep_out=tuple(one for one in keep_out if one is not None), ceiling_m=ceiling_m)


def _area(
    written: AreaFile,
    placement: Placement,
    where: Where,
    document: Document,
    findings: list[Finding],
    *,
    is_needed: bool = True,
) -> Area | None:
    given = [name for name in AreaFile.__struct_fields__ if getattr(written, name) is not None]
    if len(given) > 1 or (is_needed and not given):
        wanted = "polygon or circle" if placement.is_geo else "polygon_m or circle_m"
        findings.append(
            document.finding(where, f"exactly one area is needed, {len(given)} are given", f"give {wanted}")
        )
        return None
    if given and placement.is_geo != (given[0] in ("polygon", "circle")):
        wanted = given[0].removesuffix("_m") if placement.is_geo else given[0] + "_m"
        kind = "frame geo" if placement.is_geo else "a local frame"
        findings.append(document.finding((*where, given[0]), f"{kind} takes {wanted}, not {given[0]}", at_key=True))
        return None
    if written.circle_m is not None:
        return _round(written.circle_m.center_m, written.circle_m.radius_m, placement)
    if written.circle is not None:
        return _round(written.circle.center, written.circle.radius_m, placement)
    corners = written.polygon_m or written.polygon
    if corners is None:
        return None
    polygon = tuple(placement.ned_from((*corner, 0.0))[:2] for corner in corners)
    problem = polygon_problem(polygon)
    if problem:
        findings.append(document.finding((*where, given[0]), problem))
        return None
    return Area(polygon_ne_m=polygon)


def _round(center: Point, radius_m: float, placement: Placement) -> Area:
    north, east, _ = placement.ned_from((*center, 0.0))
    return Area(center_ne_m=(north, east), radius_m=radius_m)
