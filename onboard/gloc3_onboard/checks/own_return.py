"""Checks that the autopilot's own return stays below the mission's ceiling and inside its fence, and lands at home."""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, dist, floor
from typing import Final

from gloc3.amounts import beside
from gloc3.messages.frames import Vector3
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.fence import TOLERANCE_M, Fence
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.model import Mission
from gloc3.platform.limits import Limits
from gloc3_onboard.checks.failsafes import action_of
from gloc3_onboard.checks.fence import flights_of, reach_m
from gloc3_onboard.checks.parameters import RETURN, ReturnTable, StyleTable
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

GROUP: Final = Group.FAILSAFES
LEAST_HEIGHT_M: Final = 0.3
"""What ArduPilot takes for the height of its return at least."""
EVERY_M: Final = 2.0
"""The way home is looked at from places so far apart."""
MOST_PLACES: Final = 400
"""From no more places than that, since this is done in the control path."""


def own_return_checks(readings: Readings) -> Iterator[Check]:
    """Height, way and landing place of the return that one of the autopilot's failsafes would fly."""
    setup, mission, home = readings.setup, readings.mission, readings.home_ned_m
    if setup is None or setup.style is None or not setup.is_complete or mission is None or home is None:
        return
    table, fence = table_of(setup.style, setup.vehicle), mission.fence
    causes = _causes(setup, table, has_pilot=_has_pilot(readings))
    if fence is None or not causes:
        return
    why = f"its own return ({', '.join(causes)})"
    lines = [
        *_height(setup, table.own_return, mission, readings.platform.limits, home, why),
        *_way(mission, fence, readings.platform.limits, home, why),
        *_circle(setup, table.own_return, fence, home, causes, why),
        *_landing(setup, table.own_return, why),
    ]
    yield from lines or [Check(GROUP, "own return", Verdict.OK, f"{why} stays inside the mission's fence")]


def _has_pilot(readings: Readings) -> bool:
    return readings.platform.pilot or (readings.autopilot is not None and readings.autopilot.has_transmitter)


def _causes(setup: AutopilotSetup, table: StyleTable, *, has_pilot: bool) -> list[str]:
    """What has it return: the failsafes; without a pilot that of his transmitter never acts."""
    named = table.failsafes
    if not has_pilot:
        del named["transmitter lost"]
    return [name for name, failsafe in named.items() if action_of(setup, failsafe) == RETURN]


def _height(
    setup: AutopilotSetup, own: ReturnTable, mission: Mission, limits: Limits, home: Vector3, why: str
) -> Iterator[Check]:
    """Whether it climbs through the ceiling, or the platform's limit, wherever on the mission it begins."""
    ceiling_m = mission.fence.ceiling_m if mission.fence is not None else None
    room_m = limits.height_max_m if ceiling_m is None else ceiling_m + home[2]
    for heights in (own.heights, own.hover_heights):
        name = next((one for one in heights if one in setup.parameters), None)
        if name is not None:
            height_m, unit_m = setup.parameters[name] * heights[name], heights[name]
            yield from _climb_to(name, height_m, unit_m, room_m, limits.margin_m, why, is_ceiling=ceiling_m is not None)
        elif heights and ceiling_m is not None:
            yield Check(GROUP, "own return: height", Verdict.UNKNOWN, f"{' or '.join(heights)} could not be read")
    if ceiling_m is None:
        return
    climb = next((one for one in own.climbs if one in setup.parameters), None)
    climb_m = setup.parameters[climb] * own.climbs[climb] if climb is not None else 0.0
    if climb is not None and climb_m > 0.0 and (top_m := reach_m(mission, limits, home)["up"] + climb_m) > room_m:
        top = beside(top_m, room_m)
        finding = f"{why} climbs by {climb_m:g} m, to {top} m above home; the ceiling is {room_m:.1f} m above it"
        yield Check(GROUP, "own return: climb", Verdict.RED, finding, f"set {climb} to 0")


def _climb_to(
    name: str, height_m: float, unit_m: float, room_m: float, margin_m: float, why: str, *, is_ceiling: bool
) -> Iterator[Check]:
    """One height above home of the return, against the room above home."""
    if is_ceiling and height_m > room_m - margin_m + 1e-6:
        finding = (
            f"{why} climbs to {height_m:g} m above home; the mission's ceiling is {beside(room_m, height_m)} m above it"
        )
        most_m = max(floor(10.0 * (room_m - margin_m)) / 10.0, LEAST_HEIGHT_M)
        advice = f"set {name} to {most_m / unit_m:g} or less, which is {most_m:g} m, or raise the ceiling"
        yield Check(GROUP, "own return: height", Verdict.RED, finding, advice)
    elif not is_ceiling and height_m > room_m + 1e-6:
        finding = f"{why} climbs to {height_m:g} m above home; the platform's height_max_m is {room_m:g} m"
        advice = f"set {name} to {room_m / unit_m:g} or less"
        yield Check(GROUP, "own return: height", Verdict.WARNING, finding, advice)


def _way(mission: Mission, fence: Fence, limits: Limits, home: Vector3, why: str) -> Iterator[Check]:
    """Whether the straight way home leads through a keep-out area or out of the fence, from anywhere on the mission."""
    flat = Fence(area=fence.area, keep_out=fence.keep_out)
    for target, place in _places(mission, limits, home):
        if flat.clearance_m(place) > TOLERANCE_M >= flat.leg_clearance_m(place, home):
            north_m, east_m = place[0] - home[0], place[1] - home[1]
            finding = (
                f"{why} flies straight home: from {north_m:.0f} m north and {east_m:.0f} m east of home, on {target}, it "
                "would leave the mission's fence"
            )
            advice = (
                "have these failsafes hold or land, or change the way or the fence so that home is in sight everywhere"
            )
            yield Check(GROUP, "own return: way", Verdict.RED, finding, advice)
            return


def _places(mission: Mission, limits: Limits, home: Vector3) -> Iterator[tuple[str, Vector3]]:
    """Places along the whole way, each with the action that leads there."""
    budget, points = Budget.of(limits, home), [("", home)]
    actions = [item for part in flights_of(mission) for item in part.actions().items()]
    for target, action in actions:
        order, at = action.order, points[-1][1]
        if isinstance(order, FollowWaypointsOrder):  # there may be thousands
            ends = order.waypoints_ned_m
        else:
            ends = tuple(leg.end for leg in order.legs(at, budget))
        points += [(target, end) for end in ends]
    points = points[:: max(1, ceil(len(points) / MOST_PLACES))]
    legs = [(target, start, end) for (_, start), (target, end) in pairwise(points)]
    every_m = max(EVERY_M, sum(dist(start, end) for _, start, end in legs) / MOST_PLACES)
    for target, start, end in legs:
        count = max(1, ceil(dist(start, end) / every_m))
        for step in range(1, count + 1):
            north, east, down = (a + step / count * (b - a) for a, b in zip(start, end, strict=True))
            yield target, (north, east, down)


def _circle(
    setup: AutopilotSetup, own: ReturnTable, fence: Fence, home: Vector3, causes: list[str], why: str
) -> Iterator[Check]:
    """Whether its circle over home leaves the fence, or never ends although the battery is low."""
    radius = next((one for one in own.radii if setup.parameters.get(one)), None)
    flat = Fence(area=fence.area, keep_out=fence.keep_out)
    if radius is not None and (radius_m := abs(setup.parameters[radius])) > (room_m := flat.clearance_m(home)):
        finding = (
            f"{why} circles {radius_m:g} m around home, which is {max(room_m, 0.0):.0f} m from the mission's fence"
        )
        yield Check(
            GROUP, "own return: circle", Verdict.RED, finding, f"set {radius} to {max(floor(room_m), 0)} or less"
        )
    empty = [cause for cause in causes if cause.endswith("battery")]
    if own.circles is not None and empty and setup.parameters.get(own.circles[0]) == 0.0:
        finding = (
            f"its own return ({', '.join(empty)}) circles over home until the battery is empty ({own.circles[0]} 0)"
        )
        yield Check(GROUP, "own return: end", Verdict.RED, finding, own.circles[1])


def _landing(setup: AutopilotSetup, own: ReturnTable, why: str) -> Iterator[Check]:
    """Whether it may end elsewhere than at home."""
    if own.lands and (value := setup.parameters.get(own.lands)):
        finding = (
            f"{why} may end along a plan or elsewhere ({own.lands} {value:g}), which may be outside the mission's fence"
        )
        yield Check(
            GROUP, "own return: landing", Verdict.RED, finding, f"set {own.lands} to 0 (home, or a nearer rally point)"
        )
    count = setup.parameters.get(own.rally) if own.rally else setup.rally_points
    if count:
        source = f"{own.rally} {count:g}" if own.rally else f"it holds {count:g}"
        finding = f"{why} may end at one of its rally points ({source}), which are not compared with the fence"
        yield Check(
            GROUP,
            "own return: rally points",
            Verdict.WARNING,
            finding,
            "clear them, or see that they are inside the mission's fence",
        )
