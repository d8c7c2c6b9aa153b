"""Checks that the landing approach of a vehicle that lands on wings stays inside the fence."""

from collections.abc import Iterable, Iterator
from math import ceil, cos, degrees, inf, pi, radians, sin
from typing import Final, NamedTuple

from msgspec.structs import replace

from gloc3.documents.document import Where
from gloc3.errors import Finding
from gloc3.messages.frames import Vector3
from gloc3.mission.checking.space_check import PlacedLeg
from gloc3.mission.model.arguments import LandOrder
from gloc3.mission.model.fence import TOLERANCE_M, Fence
from gloc3.mission.model.model import Mission, where_of
from gloc3.platform.limits import Limits

STEP_DEG: Final = 5
"""Step of the runway headings that are compared, where the heading is not known."""


class LandingApproach(NamedTuple):
    """Smallest clearances of an approach in one direction, in metres."""

    least_m: float
    """On what it flies in any case: way to the approach, slope, roll-out, and a circle on one side of its begin."""
    worst_m: float
    """With the circle on the other side: the autopilot chooses the side."""


def approach_findings(
    mission: Mission,
    path: Iterable[PlacedLeg],
    limits: Limits | None,
    home_ned_m: Vector3 | None,
    heading_rad: float | None = None,
) -> Iterator[Finding]:
    """A landing approach that leaves the fence or its margin; nothing where home is not known.

    An autopilot that lands on wings flies to a place `approach_m` before home, loses height there in a circle, and
    lands at home in the direction of the take-off (ArduPilot's documentation, "AUTOLAND mode"). The path is a warning
    where it depends on the heading of the runway or on the side of the circle, or where only a policy lands.

    Args:
        mission: the mission.
        path: its legs.
        limits: those of the platform; None where they are not known.
        home_ned_m: position of arming; None where it is not known.
        heading_rad: heading of the vehicle on its runway; None where it is not known.
    """
    document, fence = mission.document, mission.fence
    if document is None or fence is None or limits is None or home_ned_m is None or limits.approach_m <= 0.0:
        return
    where: Where = ("geofence",)
    start: Vector3 | None = None
    is_landing = False
    for placed in path:
        if isinstance(placed.action.order, LandOrder):
            is_landing, where = True, (*where_of(placed.target), placed.action.capability)
            start = placed.leg.start if placed.is_start_known else None
            break
    flat, margin_m = replace(fence, ceiling_m=None), limits.margin_m - TOLERANCE_M
    headings = [radians(each) for each in range(0, 360, STEP_DEG)] if heading_rad is None else [heading_rad]
    found = [_approach(flat, limits, home_ned_m, start, each) for each in headings]
    if all(one.worst_m >= margin_m for one in found):
        return
    may = "leaves" if all(one.least_m < margin_m for one in found) else "may leave"
    along = "whatever the heading of the runway" if may == "leaves" else "depending on the heading of the runway"
    if heading_rad is not None:
        along = f"with the runway at {degrees(heading_rad) % 360.0:.0f} degrees, as the vehicle stands"
    message = (
        f"the landing approach {may} the fence or its margin of {limits.margin_text()}, {along}: it begins "
        f"{limits.approach_m:g} m before home with a circle of {limits.turn_radius_m:g} m, and ends "
        f"{limits.landing_roll_m:g} m beyond home"
    )
    fitting = [heading for heading, one in zip(headings, found, strict=True) if one.worst_m >= margin_m]
    missing_m = ceil(limits.margin_m - max(one.worst_m for one in found))
    hint = f"take off at {_ranges(fitting)} degrees, or widen the fence" if fitting else "widen the fence"
    hint += f" by {missing_m} m" if not fitting else ""
    is_warning = may != "leaves" or not is_landing
    yield document.finding(where, message, hint, at_key=True, is_warning=is_warning)


def _approach(
    fence: Fence, limits: Limits, home: Vector3, start: Vector3 | None, heading_rad: float
) -> LandingApproach:
    """The approach to home in a direction, from a place where one is known and inside."""
    begin, radius_m = _ahead(home, heading_rad, -limits.approach_m), limits.turn_radius_m
    straight_m = fence.leg_clearance_m(begin, _ahead(home, heading_rad, limits.landing_roll_m))
    if start is not None and fence.clearance_m(start) >= limits.margin_m:
        straight_m = min(straight_m, fence.leg_clearance_m(start, begin))
    sides = [fence.clearance_m(_ahead(begin, heading_rad + side, radius_m)) - radius_m for side in (-pi / 2, pi / 2)]
    return LandingApproach(min(straight_m, max(sides)), min(straight_m, *sides))


def _ahead(place: Vector3, heading_rad: float, distance_m: float) -> Vector3:
    return (place[0] + distance_m * cos(heading_rad), place[1] + distance_m * sin(heading_rad), place[2])


def _ranges(headings_rad: list[float]) -> str:
    """Headings in steps, as ranges: `45 to 120 or 225 to 300`."""
    steps = [round(degrees(heading)) for heading in headings_rad]
    found: list[list[float]] = []
    before = -inf
    for step in steps:
        if step - before > STEP_DEG:
            found.append([step, step])
        found[-1][1] = before = step
    if len(found) > 1 and found[0][0] == 0 and found[-1][1] == 360 - STEP_DEG:
        found[0][0] = found.pop()[0]
    return " or ".join(f"{first:g} to {last:g}" if first != last else f"{first:g}" for first, last in found)
