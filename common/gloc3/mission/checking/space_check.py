"""Checks that a mission stays inside the fence and the platform's limits, and begins and ends on the ground."""

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple

from gloc3.amounts import beside, excess
from gloc3.component.deployment import ComponentRow
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, Gloc3Error
from gloc3.messages.frames import Vector3
from gloc3.messages.standard_topics import POSE_LATE_S
from gloc3.messages.vehicle import HeightAboveGround
from gloc3.mission.checking.estimate import MissionEstimate
from gloc3.mission.checking.option_check import kept_options
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.abilities import abilities
from gloc3.mission.model.arguments import FollowWaypointsOrder, LandOrder, ReturnHome
from gloc3.mission.model.exploring import ExploreOrder
from gloc3.mission.model.fence import TOLERANCE_M, Fence
from gloc3.mission.model.legs import FlightLeg
from gloc3.mission.model.model import FLY_PLAN, Action, Mission, where_of
from gloc3.mission.model.structure import PartialOrder
from gloc3.platform.limits import Limits
from gloc3.platform.platform import Platform


def flight_findings(mission: Mission, order: PartialOrder, *, is_airborne: bool) -> Iterator[Finding]:
    """Take-off comes before all other motion, once, and a landing at the end."""
    document = mission.document
    actions = mission.actions()
    moving = list(_unrolled(mission, [one for one in order.targets if one in actions and actions[one].order.moves]))
    if document is None or not moving:
        return
    is_from_ground = any(actions[target].order.begins_flight for target in moving)
    if not is_from_ground and not is_airborne:
        hint = "begin with take_off"
        yield document.finding(
            ("tasks",), "without take_off it can only be started in the air", hint, at_key=True, is_warning=True
        )
    in_air = is_airborne or not is_from_ground
    for target in moving:
        kind = actions[target].order
        where = (*where_of(target), actions[target].capability)
        if kind.begins_flight:
            if in_air:
                yield document.finding(where, f"{target} takes off while in the air", "land first", at_key=True)
            in_air = True
        elif not in_air:
            yield document.finding(where, f"{target} moves the vehicle on the ground", "take off first", at_key=True)
        if kind.ends_flight:
            in_air = False
    if in_air:
        yield document.finding(
            ("tasks",),
            "the mission ends in the air, and the vehicle stays there",
            "end with land",
            at_key=True,
            is_warning=True,
        )


def _unrolled(mission: Mission, targets: list[str]) -> Iterator[str]:
    """Actions in order, those of a repeated task twice, because any of its actions may follow the last one."""
    for name, group in groupby(targets, key=lambda target: target.partition(".")[0]):
        own = list(group)
        yield from own
        repeat = mission.tasks[name].options.repeat
        yield from own if repeat is not None and repeat.times > 1 else ()


def space_findings(
    mission: Mission, path: Iterable["PlacedLeg"], limits: Limits | None, home_ned_m: Vector3 | None
) -> list[Finding]:
    """Waypoints and legs outside the fence (margin included), too low, too high, and too fast.

    Places that are not known are not judged; where home is not known, heights count from the origin.
    """
    document = mission.document
    if document is None:
        return []
    found: list[Finding] = []
    home = home_ned_m or (0.0, 0.0, 0.0)
    for placed in path:
        action, leg, fence = placed.action, placed.leg, mission.fence
        place = place_of((*where_of(placed.target), action.capability), action, leg, document)
        if fence is not None:
            fence = fence if placed.is_end_known else Fence(ceiling_m=fence.ceiling_m)
            is_straight = not (isinstance(action.order, FollowWaypointsOrder) and action.order.plan)
            is_start_known = placed.is_start_known and is_straight
            found += _fence(leg, fence, limits, document, place, is_start_known=is_start_known)
        lands = isinstance(action.order, LandOrder) or (action.order.ends_flight and leg.waypoint is None)
        if limits is not None and not lands and leg.length_m > 0.0:
            found += _height(leg.end, home, limits, document, place)
    if limits is not None:
        found += _speeds(mission, limits, document)
        found += _late(mission, limits, document)
    return found


def _late(mission: Mission, limits: Limits, document: Document) -> Iterator[Finding]:
    """Paths near the fence so fast that a late pose takes the vehicle through the margin before it brakes.

    The limiter plans to stop inside the margin, from the pose that it has; it brakes `POSE_LATE_S` after the last one.
    """
    if mission.fence is None or limits.turn_radius_m > 0.0:
        return
    for target, action in mission.actions().items():
        order = action.order
        if not isinstance(order, FollowWaypointsOrder) or order.speed_m_s > limits.speed_m_s:
            continue
        late_m = order.speed_m_s * POSE_LATE_S
        stops_m = late_m + order.speed_m_s**2 / (2.0 * limits.acceleration_m_s2)
        nearest_m = min(mission.fence.clearance_m(place) for place in order.waypoints_ned_m)
        if late_m > limits.fence_margin_m and nearest_m < stops_m:
            message = (
                f"at {order.speed_m_s:g} m/s it flies {beside(late_m, limits.fence_margin_m)} m before it brakes for a late pose, more than the margin of "
                f"{limits.fence_margin_m:g} m, and comes within {nearest_m:.1f} m of the fence"
            )
            where = (*where_of(target), action.capability)
            yield document.finding(where, message, "fly slower, or raise fence_margin_m", at_key=True, is_warning=True)


def _speeds(mission: Mission, limits: Limits, document: Document) -> Iterator[Finding]:
    for target, action in mission.actions().items():
        kinds = FollowWaypointsOrder | ReturnHome | ExploreOrder
        speed_m_s = action.order.speed_m_s if isinstance(action.order, kinds) else None
        if speed_m_s is not None and speed_m_s > limits.speed_m_s:
            message = f"{speed_m_s:g} m/s exceeds the platform's limit of {limits.speed_m_s:g} m/s"
            yield document.finding((*where_of(target), action.capability, "speed_m_s"), message, "fly slower")


class PlacedLeg(NamedTuple):
    """A leg of a mission's path, and whether the positions of its ends are known."""

    target: str
    action: Action
    leg: FlightLeg
    is_start_known: bool
    is_end_known: bool


def placed_legs(
    mission: Mission, figures: MissionEstimate, home_ned_m: Vector3 | None = None, start_ned_m: Vector3 | None = None
) -> Iterator[PlacedLeg]:
    """All legs of a mission's path, in order.

    The position of a waypoint is always known. Where home is unknown, so are the positions of departure and return, and
    of the actions there until the next waypoint, such as landing.

    Args:
        mission: the mission.
        figures: its estimate, from an arbitrary start where home is unknown.
        home_ned_m: position of arming; None where it is unknown.
        start_ned_m: start position; None for at home.
    """
    actions = mission.actions()
    is_known = home_ned_m is not None or start_ned_m is not None
    for target, part in figures.actions.items():
        order, legs = actions[target].order, part.legs
        has_places = isinstance(order, FollowWaypointsOrder | FlyFileOrder)
        has_places = has_places or getattr(order, "at_ned_m", None) is not None
        if isinstance(order, FollowWaypointsOrder) and (not legs or legs[0].waypoint != 0):  # it begins at the first
            first = order.waypoints_ned_m[0]
            legs = (FlightLeg(start=first, end=first, duration_s=0.0, waypoint=0), *legs)
        for leg in legs:
            is_moved = leg.start[:2] != leg.end[:2]
            if isinstance(order, ReturnHome) and is_moved:
                is_end_known = home_ned_m is not None
            else:
                is_end_known = is_known or has_places or is_moved
            yield PlacedLeg(target, actions[target], leg, is_known, is_end_known)
            is_known = is_end_known
        if isinstance(order, ReturnHome):
            is_known = home_ned_m is not None


def place_of(where: Where, action: Action, leg: FlightLeg, document: Document) -> Where:
    """The location in the file of a leg's target; for a plan of another program with the item's name behind it."""
    if isinstance(action.order, FlyFileOrder):
        number = leg.waypoint if leg.waypoint is not None else len(action.order.path) - 1
        return (*where[:2], "plan", action.order.path[number].name if action.order.path else "the plan")
    for key in ("waypoints_m", "waypoints"):
        if getattr(action.arguments, key, None) is not None and leg.waypoint is not None:
            order, index = action.order, leg.waypoint
            return (*where, key, order.number_of(index) if isinstance(order, FollowWaypointsOrder) else index)
    for key in ("position_m", "position", "at_m", "at", "height_m"):
        if key in document.node(where).children:
            return (*where, key)
    return where


def _fence(
    leg: FlightLeg, fence: Fence, limits: Limits | None, document: Document, place: Where, *, is_start_known: bool
) -> Iterator[Finding]:
    margin_m, margin = (0.0, "0 m") if limits is None else (limits.margin_m, limits.margin_text())
    clearance_m = fence.clearance_m(leg.end)
    if clearance_m < margin_m - TOLERANCE_M:
        if clearance_m < 0.0:
            message = f"{name_of(place)} is {excess(-clearance_m)} m outside the fence"
        else:
            inside = beside(clearance_m, margin_m, 2)
            message = f"{name_of(place)} is {inside} m inside the fence, less than the margin of {margin}"
        yield document.finding(place, message, "move it inwards")
    elif is_start_known and fence.clearance_m(leg.start) >= margin_m - TOLERANCE_M:
        along_m = fence.leg_clearance_m(leg.start, leg.end)
        if along_m < margin_m - TOLERANCE_M:
            message = f"the straight path to {name_of(place)} leaves the fence or its margin of {margin}"
            yield document.finding(place, message, "add a waypoint to go around")


def _height(point: Vector3, home: Vector3, limits: Limits, document: Document, place: Where) -> Iterator[Finding]:
    height_m, most_m, least_m = home[2] - point[2], limits.height_max_m, limits.height_min_m
    if height_m > most_m + TOLERANCE_M:
        message = f"{name_of(place)} is {beside(height_m, most_m)} m above home; the platform's limit is {most_m:g} m"
        hint = f"lower it by {excess(height_m - most_m, is_enough=True)} m, or raise limits.height_max_m in the platform file"
        yield document.finding(place, message, hint)
    elif height_m < least_m - TOLERANCE_M:
        message = f"{name_of(place)} is {beside(height_m, least_m)} m above home; the platform's limit is {least_m:g} m"
        hint = f"raise it by {excess(least_m - height_m, is_enough=True)} m, or lower limits.height_min_m in the platform file"
        yield document.finding(place, message, hint)


def name_of(place: Where) -> str:
    """A place for a person: a waypoint, an item of a plan, or the end of an action."""
    if len(place) == 4 and place[2] == "plan":
        return str(place[3])
    return f"waypoint {place[-1] + 1}" if isinstance(place[-1], int) else f"{place[3]}'s end"


def altitude_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """An `altitude_m` that the platform cannot hold, or that is below its limit."""
    document = mission.document
    if document is None or platform is None:
        return
    rows, topics, known = {row.name: row for row in platform.components}, platform.topics(), abilities(platform)
    for target, action in mission.actions().items():
        order = action.order
        if not isinstance(order, FollowWaypointsOrder) or order.altitude_m is None or action.ability == FLY_PLAN:
            continue
        where = (*where_of(target), action.capability, "altitude_m")
        ability = known.get(action.ability)
        row = rows.get(ability.performed_by) if ability is not None else None
        if row is not None and "altitude_m" in kept_options(row) and not _has_height_source(row, topics):
            message = f"{row.name} of {platform.platform} cannot hold a height above ground: it receives none"
            yield document.finding(where, message, "set height_m, or bind its input to a range finder")
        least_m = platform.limits.altitude_min_m
        if order.altitude_m < least_m:
            message = f"{order.altitude_m:g} m above ground is below the platform's limit of {least_m:g} m"
            yield document.finding(where, message, "raise altitude_m")


def _has_height_source(row: ComponentRow, topics: set[str]) -> bool:
    """Whether a component's inputs bring it heights over the ground; true where its class is not installed here."""
    try:
        inputs = row.load_class().inputs
    except Gloc3Error:
        return True
    received = (topic for port, of in inputs.items() if of.message is HeightAboveGround for topic in row.topics(port))
    return any(topic in topics for topic in received)
