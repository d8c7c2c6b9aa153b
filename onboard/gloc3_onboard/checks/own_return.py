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
from gloc3_onboard.checks.fence import reach_m
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
    causes = _causes(setup, table)
    if fence is None or not causes:
        return
    why = f"its own return ({', '.join(causes)})"
    lines = [
        *_height(setup, table.own_return, mission, readings.platform.limits, home, why),
        *_way(mission, fence, readings.platform.limits, home, why),
        *_landing(setup, table.own_return, why),
    ]
    yield from lines or [Check(GROUP, "own return", Verdict.OK, f"{why} stays inside the mission's fence")]


def _causes(setup: AutopilotSetup, table: StyleTable) -> list[str]:
    """The failsafes that return."""
    named = {
        "link loss": table.link_loss,
        "low battery": table.low_battery,
        "setpoints lost": table.setpoints_lost,
        "fence": table.fence.breach,
    }
    return [name for name, failsafe in named.items() if action_of(setup, failsafe) == RETURN]


def _height(
    setup: AutopilotSetup, own: ReturnTable, mission: Mission, limits: Limits, home: Vector3, why: str
) -> Iterator[Check]:
    """Whether it climbs through the ceiling, wherever on the mission it begins."""
    ceiling_m = mission.fence.ceiling_m if mission.fence is not None else None
    if ceiling_m is None or not own.heights:
        return
    room_m = ceiling_m + home[2]
    name = next((one for one in own.heights if one in setup.parameters), None)
    if name is None:
        yield Check(GROUP, "own return: height", Verdict.UNKNOWN, f"{' or '.join(own.heights)} could not be read")
        return
    unit_m = own.heights[name]
    height_m = setup.parameters[name] * unit_m
    if height_m > room_m - limits.margin_m + 1e-6:
        finding = (
            f"{why} climbs to {height_m:g} m above home; the mission's ceiling is {beside(room_m, height_m)} m above it"
        )
        most_m = max(floor(10.0 * (room_m - limits.margin_m)) / 10.0, LEAST_HEIGHT_M)
        advice = f"set {name} to {most_m / unit_m:g} or less, which is {most_m:g} m, or raise the ceiling"
        yield Check(GROUP, "own return: height", Verdict.RED, finding, advice)
    climb = next((one for one in own.climbs if one in setup.parameters), None)
    climb_m = setup.parameters[climb] * own.climbs[climb] if climb is not None else 0.0
    if climb is not None and climb_m > 0.0 and (top_m := reach_m(mission, limits, home)["up"] + climb_m) > room_m:
        top = beside(top_m, room_m)
        finding = f"{why} climbs by {climb_m:g} m, to {top} m above home; the ceiling is {room_m:.1f} m above it"
        yield Check(GROUP, "own return: climb", Verdict.RED, finding, f"set {climb} to 0")


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
    for target, action in mission.actions().items():
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
