"""Checks that a vehicle that cannot stop or turn on the spot, such as a plane, can fly a mission's path."""

from collections.abc import Container, Iterable, Iterator, Sequence
from itertools import pairwise
from math import atan2, cos, degrees, dist, pi, sin, tan
from typing import Final

from msgspec.structs import replace

from gloc3.amounts import beside
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding
from gloc3.messages.frames import Vector3, wrap_pi
from gloc3.mission.checking.estimate import MissionEstimate
from gloc3.mission.checking.space_check import PlacedLeg, name_of, place_of
from gloc3.mission.model.arguments import FollowWaypointsOrder, Hold, LandOrder, ReturnHome, TakeOff
from gloc3.mission.model.legs import FlightLeg
from gloc3.mission.model.model import GEO, Action, Mission, where_of
from gloc3.platform.limits import Limits
from gloc3.platform.platform import Platform

_WIDEST_RAD: Final = 2.2
"""Wider turns need no more room: they are flown as a circle."""
_SHORT_M: Final = 1.0
"""A leg that is no longer leads nowhere else."""


def turn_findings(
    mission: Mission, figures: MissionEstimate, path: Iterable[PlacedLeg], platform: Platform | None
) -> Iterator[Finding]:
    """Legs too short for their turns, too slow or too steep; circles too close to the fence; needed stops.

    Circles around places that are not known are not judged.
    """
    document = mission.document
    if document is None or platform is None or platform.limits.turn_radius_m <= 0.0:
        return
    limits = platform.limits
    actions = mission.actions()
    unknown = {one.leg for one in path if not one.is_end_known}
    for target, part in figures.actions.items():
        action = actions[target]
        where = (*where_of(target), action.capability)
        yield from _impossible(action, where, limits, document)
        routes = [leg for leg in part.legs if dist(leg.start[:2], leg.end[:2]) > _SHORT_M]
        if limits.rotors_speed_m_s > 0.0 and not _goes_on_wings(action, routes, limits):
            continue
        yield from _too_slow(action, where, limits, document)
        if limits.rotors_speed_m_s > 0.0:
            yield from _transitions(mission, action, where, routes, limits, document)
        if isinstance(action.order, FollowWaypointsOrder):
            yield from _legs(action, where, routes, limits, document)
        if not isinstance(action.order, LandOrder):
            yield from _circles(mission, action, where, routes or part.legs, unknown, limits, document)
    if mission.fence is not None and mission.frame != GEO and mission.frame not in platform.frames:
        message = (
            f"the autopilot has no fence in frame {mission.frame}, which has no place on Earth in the platform file: "
            "a breach is detected, but not prevented"
        )
        hint = "declare the frame in the platform file, or write the mission in frame geo"
        yield document.finding(("geofence",), message, hint, at_key=True, is_warning=True)


def _goes_on_wings(action: Action, legs: Sequence[FlightLeg], limits: Limits) -> bool:
    """Whether what can hover flies this way on wings."""
    order, length_m = action.order, sum(leg.length_m for leg in legs)
    if isinstance(order, FollowWaypointsOrder | ReturnHome):
        return limits.is_on_wings(length_m, order.by if isinstance(order, FollowWaypointsOrder) else None)
    return False


def _transitions(
    mission: Mission, action: Action, where: Where, legs: Sequence[FlightLeg], limits: Limits, document: Document
) -> Iterator[Finding]:
    """A way that is too short or too low for its transitions, and places beyond which it would stop outside the fence."""
    length_m, needed_m = sum(leg.length_m for leg in legs), 2.0 * limits.transition_m
    if length_m < needed_m:
        message = f"{beside(length_m, needed_m, 0)} m is too short to fly on wings: transitions to wings and to a hover take {needed_m:g} m"
        yield document.finding(where, message, "by: rotors", at_key=True)
    for leg in legs:
        if (height_m := -leg.end[2]) < limits.wings_height_min_m - _SHORT_M and isinstance(
            action.order, FollowWaypointsOrder
        ):
            place = place_of(where, action, leg, document)
            least_m = limits.wings_height_min_m
            message = f"{name_of(place)} is {beside(height_m, least_m, 0)} m high: limit on wings {least_m:g} m"
            yield document.finding(place, message, "fly higher, or by: rotors")
            break
    if mission.fence is None or not legs:
        return
    fence = replace(mission.fence, ceiling_m=None)  # a transition is level
    begin_m = fence.clearance_m(legs[0].start)
    if begin_m < limits.transition_m:
        message = (
            f"it goes over to its wings {beside(begin_m, limits.transition_m, 0)} m inside the fence; that takes {limits.transition_m:g} m, to where "
            "its nose points"
        )
        yield document.finding(where, message, "fly away from the fence by rotors before", at_key=True)
    for leg in legs[:-1]:
        course_rad = _course_rad(leg.start, leg.end)
        north, east, down = leg.end
        ahead_m = limits.transition_m
        beyond = (north + ahead_m * cos(course_rad), east + ahead_m * sin(course_rad), down)
        if fence.clearance_m(beyond) < 0.0:
            place = place_of(where, action, leg, document)
            message = (
                f"told to land or to hover at {name_of(place)} it stops up to {ahead_m:g} m ahead, outside the fence"
            )
            yield document.finding(place, message, "move it inwards")
            break


def _too_slow(action: Action, where: Where, limits: Limits, document: Document) -> Iterator[Finding]:
    """What on wings would fall, or cannot point where it does not fly."""
    order = action.order
    speed_m_s = order.speed_m_s if isinstance(order, FollowWaypointsOrder | ReturnHome) else None
    if speed_m_s is not None and speed_m_s < limits.speed_min_m_s:
        message = f"{speed_m_s:g} m/s is below the minimum of {limits.speed_min_m_s:g} m/s that keeps it in the air"
        yield document.finding((*where, "speed_m_s"), message, "fly faster")
    if isinstance(order, FollowWaypointsOrder) and not order.heading.follows_path:
        message = "a fixed-wing vehicle cannot choose its heading"
        yield document.finding((*where, "heading"), message, "remove heading")


def _impossible(action: Action, where: Where, limits: Limits, document: Document) -> Iterator[Finding]:
    """What only a vehicle can do that stops."""
    order = action.order
    if isinstance(order, LandOrder) and order.at_ned_m is not None:
        message, hint = "the autopilot chooses where this vehicle lands: at home, along its runway", "remove the place"
        if limits.rotors_speed_m_s > 0.0:
            message, hint = "this vehicle lands where it hovers", "remove the place, and fly there before"
        yield document.finding(where, message, hint, at_key=True)
    if isinstance(order, TakeOff) and order.height_m < limits.height_min_m:
        message = f"take-off to {order.height_m:g} m is below the platform's limit of {limits.height_min_m:g} m"
        yield document.finding(where, message, "take off higher", at_key=True)


def _legs(
    action: Action, where: Where, legs: Sequence[FlightLeg], limits: Limits, document: Document
) -> Iterator[Finding]:
    """The first leg that is too short for its turns, and the first that is too steep."""
    order, radius_m = action.order, limits.turn_radius_m
    assert isinstance(order, FollowWaypointsOrder)
    sides = _joined(legs, order)
    turns = [_turn_rad(one, other) for one, other in pairwise(sides)]
    for number, (leg, before, after) in enumerate(zip(sides[1:], turns, [*turns, 0.0][1:], strict=True), 2):
        needed_m = radius_m * (_share(before) + _share(after))
        flat_m = dist(leg.start[:2], leg.end[:2])
        if flat_m < needed_m - _SHORT_M:
            place = place_of(where, action, leg, document)
            message = (
                f"leg {number} is {flat_m:.0f} m long; to turn by {degrees(before):.0f} and {degrees(after):.0f} "
                f"degrees at its ends with a radius of {radius_m:g} m takes {needed_m:.0f} m"
            )
            yield document.finding(place, message, "make the area wider, or move its places apart")
            break
    for leg in legs:
        rise_m, flat_m = leg.start[2] - leg.end[2], dist(leg.start[:2], leg.end[:2])
        possible_m = limits.climb_m_s * flat_m / order.speed_m_s
        if abs(rise_m) > possible_m + _SHORT_M and leg is not legs[0]:
            place = place_of(where, action, leg, document)
            message = f"{abs(rise_m):.0f} m up or down on {flat_m:.0f} m to {name_of(place)}: limit {possible_m:.0f} m"
            yield document.finding(place, message, "fly slower, or lengthen the leg")
            break


def _joined(legs: Sequence[FlightLeg], order: FollowWaypointsOrder) -> Sequence[FlightLeg]:
    """Legs from waypoint to waypoint of the mission, without the places between that follow the ground."""
    if not order.between:
        return legs
    found: list[FlightLeg] = []
    between = set(order.between)
    for leg in legs:
        if found and found[-1].waypoint in between:
            leg = replace(leg, start=found.pop().start)
        found.append(leg)
    return found


def _circles(
    mission: Mission,
    action: Action,
    where: Where,
    legs: Sequence[FlightLeg],
    unknown: Container[FlightLeg],
    limits: Limits,
    document: Document,
) -> Iterator[Finding]:
    """Places where it circles, or swings out, too near to the fence; not at the ends of `unknown` legs."""
    order = action.order
    if mission.fence is None or not legs:
        return
    fence = replace(mission.fence, ceiling_m=None)  # it turns level
    waits = isinstance(order, Hold) or (isinstance(order, FollowWaypointsOrder) and order.rest_s > 0.0)
    hovers_at_end = limits.rotors_speed_m_s > 0.0
    for leg, after in zip(
        legs[:-1] if hovers_at_end else legs, [*legs[1:], *([] if hovers_at_end else [None])], strict=True
    ):
        turn = pi / 2.0 if after is None or waits else min(_turn_rad(leg, after), pi / 2.0)
        needed_m = limits.turn_radius_m * (1.0 - cos(turn))
        clearance_m = fence.clearance_m(leg.end)
        if leg not in unknown and limits.margin_m <= clearance_m < needed_m:
            place = place_of(where, action, leg, document)
            does = "circles there" if after is None or waits else "turns there"
            message = (
                f"{name_of(place)} is {clearance_m:.0f} m inside the fence, and it {does}: that takes {needed_m:.0f} m"
            )
            yield document.finding(place, message, "move it inwards")
            return


def _turn_rad(one: FlightLeg, other: FlightLeg) -> float:
    return abs(wrap_pi(_course_rad(other.start, other.end) - _course_rad(one.start, one.end)))


def _course_rad(start: Vector3, end: Vector3) -> float:
    return atan2(end[1] - start[1], end[0] - start[0])


def _share(turn_rad: float) -> float:
    """Distance from a corner at which a turn begins and ends, as a share of the radius."""
    return tan(0.5 * min(turn_rad, _WIDEST_RAD))
