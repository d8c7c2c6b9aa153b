"""Checks that a mission stays inside the fence and the platform's limits, and begins and ends on the ground."""

from collections.abc import Iterator
from itertools import groupby

from gloc3.component.deployment import ComponentRow
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, Gloc3Error
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import HeightAboveGround
from gloc3.mission.checking.estimate import MissionEstimate
from gloc3.mission.checking.option_check import kept_options
from gloc3.mission.model.abilities import abilities
from gloc3.mission.model.arguments import FollowWaypointsOrder, LandOrder, ReturnHome, SetOff
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
    is_from_ground = any(isinstance(actions[target].order, SetOff) for target in moving)
    if not is_from_ground and not is_airborne:
        hint = "begin with take_off"
        yield document.finding(
            ("tasks",), "without take_off it can only be started in the air", hint, at_key=True, is_warning=True
        )
    in_air = is_airborne or not is_from_ground
    for target in moving:
        kind = actions[target].order
        where = (*where_of(target), actions[target].capability)
        if isinstance(kind, SetOff):
            if in_air:
                yield document.finding(where, f"{target} takes off in the air", "land first", at_key=True)
            in_air = True
        elif not in_air:
            yield document.finding(where, f"{target} moves the vehicle on the ground", "take off first", at_key=True)
        elif isinstance(kind, LandOrder):
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
    """The actions in their order, those of a task that is repeated twice: what may come next does so."""
    for name, group in groupby(targets, key=lambda target: target.partition(".")[0]):
        own = list(group)
        yield from own
        repeat = mission.tasks[name].options.repeat
        yield from own if repeat is not None and repeat.times > 1 else ()


def space_findings(
    mission: Mission,
    figures: MissionEstimate,
    limits: Limits | None,
    *,
    home_ned_m: Vector3 | None,
    start_ned_m: Vector3 | None,
) -> list[Finding]:
    """Waypoints and legs outside the fence (margin included), too low, too high, and too fast.

    Where home is not known, legs that begin or end there are not judged, and heights count from the origin.
    """
    document = mission.document
    if document is None:
        return []
    found: list[Finding] = []
    actions = mission.actions()
    home = home_ned_m or (0.0, 0.0, 0.0)
    is_place_known = start_ned_m is not None or home_ned_m is not None
    for target, part in figures.actions.items():
        action = actions[target]
        where = (*where_of(target), action.capability)
        ends_at_home = isinstance(action.order, ReturnHome)
        for leg in part.legs:
            place = place_of(where, action, leg, document)
            fence = mission.fence
            if fence is not None and home_ned_m is None and isinstance(action.order, ReturnHome | SetOff):
                fence = Fence(ceiling_m=fence.ceiling_m)
            if fence is not None:
                margin_m = limits.fence_margin_m if limits is not None else 0.0
                found += _fence(leg, fence, margin_m, document, place, is_start_known=is_place_known)
            if limits is not None and not isinstance(action.order, LandOrder) and leg.length_m > 0.0:
                found += _height(leg.end, home, limits, document, place)
            is_place_known = not ends_at_home or home_ned_m is not None
        if isinstance(action.order, SetOff) and home_ned_m is None:
            is_place_known = False
        if limits is not None and isinstance(action.order, FollowWaypointsOrder | ReturnHome):
            speed_m_s = action.order.speed_m_s
            if speed_m_s is not None and speed_m_s > limits.speed_m_s:
                message = f"{speed_m_s:g} m/s exceeds the platform's limit of {limits.speed_m_s:g} m/s"
                found.append(document.finding((*where, "speed_m_s"), message, "fly slower"))
    return found


def place_of(where: Where, action: Action, leg: FlightLeg, document: Document) -> Where:
    """The location in the file of a leg's target."""
    for key in ("waypoints_m", "waypoints"):
        if getattr(action.arguments, key, None) is not None and leg.waypoint is not None:
            return (*where, key, leg.waypoint)
    for key in ("position_m", "position", "at_m", "at", "height_m"):
        if key in document.node(where).children:
            return (*where, key)
    return where


def _fence(
    leg: FlightLeg, fence: Fence, margin_m: float, document: Document, place: Where, *, is_start_known: bool
) -> Iterator[Finding]:
    clearance_m = fence.clearance_m(leg.end)
    if clearance_m < margin_m - TOLERANCE_M:
        if clearance_m < 0.0:
            message = f"{name_of(place)} is {-clearance_m:.1f} m outside the fence"
        else:
            message = (
                f"{name_of(place)} is {clearance_m:.2f} m inside the fence, less than the margin of {margin_m:g} m"
            )
        yield document.finding(place, message, "move it inwards")
    elif is_start_known and fence.clearance_m(leg.start) >= margin_m - TOLERANCE_M:
        along_m = fence.leg_clearance_m(leg.start, leg.end)
        if along_m < margin_m - TOLERANCE_M:
            message = f"the straight path to {name_of(place)} leaves the fence or its margin of {margin_m:g} m"
            yield document.finding(place, message, "add a waypoint to go around")


def _height(point: Vector3, home: Vector3, limits: Limits, document: Document, place: Where) -> Iterator[Finding]:
    height_m = home[2] - point[2]
    if height_m > limits.height_max_m + TOLERANCE_M:
        message = f"{name_of(place)} is {height_m:.1f} m above home; the platform's limit is {limits.height_max_m:g} m"
        yield document.finding(place, message, "fly lower")
    elif height_m < limits.height_min_m - TOLERANCE_M:
        message = f"{name_of(place)} is {height_m:.1f} m above home; the platform's limit is {limits.height_min_m:g} m"
        yield document.finding(place, message, "fly higher")


def name_of(place: Where) -> str:
    """A place for a person: a waypoint, or the end of an action."""
    return f"waypoint {place[-1] + 1}" if isinstance(place[-1], int) else f"{place[3]}'s end"


def altitude_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """An `altitude_m` on a platform that cannot hold it, or one below the platform's limit."""
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
