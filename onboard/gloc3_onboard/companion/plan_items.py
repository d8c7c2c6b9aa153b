"""Items of MAVLink's mission protocol, and what they stand for in a plan: judged one by one, converted both ways."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.mavlink.services.plan import FRAME_MISSION, PlanItem, PlanResult
from gloc3.mavlink.services.plan import Plan as Items
from gloc3.mission.formats.items import Entry, FenceArea, MavItem, Plan
from gloc3.mission.formats.to_mission import CONVERTED, LEFT_OUT
from gloc3.plan_wire import from_wire, to_wire

UNITS_PER_DEGREE: Final = 1e7
RETURN_POINT, POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT = range(5000, 5005)
_FRAMES: Final = frozenset({0, 2, 3, 5, 6, 10, 11})
"""Global ones, and that of items without a place."""
_PLACED: Final = frozenset({16, 19, 21, 22, 195, 201})


class Verdict(NamedTuple):
    """What is wrong with a plan."""

    result: PlanResult
    reason: str


def judge(items: Items) -> Verdict | None:
    """What is wrong with the first item that cannot be flown; None where all can be, as far as each tells."""
    for number, item in enumerate(items):
        found = _judge_item(item)
        if found is not None:
            return Verdict(found.result, f"item {number}: {found.reason}")
    return None


def _judge_item(item: PlanItem) -> Verdict | None:
    if item.command not in CONVERTED and item.command not in LEFT_OUT:
        return Verdict(PlanResult.UNSUPPORTED, f"command {item.command} cannot be expressed in a mission")
    if item.frame not in _FRAMES:
        return Verdict(PlanResult.UNSUPPORTED_FRAME, f"frame {item.frame} is not supported")
    params = (item.param1, item.param2, item.param3, item.param4)
    for number, value in enumerate(params):
        if math.isinf(value):
            return Verdict(PlanResult(PlanResult.INVALID_PARAM1 + number), f"param{number + 1} is infinite")
    if item.command not in _PLACED or item.frame == FRAME_MISSION:
        return None
    if abs(item.x) > 90 * UNITS_PER_DEGREE:
        return Verdict(PlanResult.INVALID_PARAM5_X, f"latitude {item.x / UNITS_PER_DEGREE:g} is not on Earth")
    if abs(item.y) > 180 * UNITS_PER_DEGREE:
        return Verdict(PlanResult.INVALID_PARAM6_Y, f"longitude {item.y / UNITS_PER_DEGREE:g} is not on Earth")
    if not math.isfinite(item.z):
        return Verdict(PlanResult.INVALID_PARAM7_Z, "its height is no number")
    return None


def plan_of(items: Items, fence: Sequence[FenceArea]) -> Plan:
    """The plan that items of a mission, and a fence, stand for."""
    return Plan(entries=tuple(Entry(items=(from_wire(item),)) for item in items), fence=tuple(fence))


def fence_of(items: Items) -> tuple[FenceArea, ...] | Verdict:
    """The areas that items of a fence stand for; or what is wrong with them."""
    areas: list[FenceArea] = []
    corners: list[tuple[float, float]] = []
    for number, item in enumerate(items):
        place = (item.x / UNITS_PER_DEGREE, item.y / UNITS_PER_DEGREE)
        if item.frame not in _FRAMES:
            return Verdict(PlanResult.UNSUPPORTED_FRAME, f"item {number}: frame {item.frame} is not supported")
        if item.command in (CIRCLE_IN, CIRCLE_OUT):
            if not (math.isfinite(item.param1) and item.param1 > 0.0):
                return Verdict(PlanResult.INVALID_PARAM1, f"item {number}: a circle without a radius")
            areas.append(FenceArea(is_inclusion=item.command == CIRCLE_IN, center=place, radius_m=item.param1))
        elif item.command in (POLYGON_IN, POLYGON_OUT):
            corners.append(place)
            follows = number + 1 < len(items) and items[number + 1].command == item.command
            if not (math.isfinite(item.param1) and item.param1 >= 3 and len(corners) <= item.param1):
                return Verdict(PlanResult.INVALID_PARAM1, f"item {number}: a polygon of {item.param1:g} corners")
            if len(corners) == item.param1:
                areas.append(FenceArea(is_inclusion=item.command == POLYGON_IN, polygon=tuple(corners)))
                corners = []
            elif not follows:
                return Verdict(PlanResult.INVALID, f"item {number}: a polygon lacks corners")
        elif item.command != RETURN_POINT:
            return Verdict(PlanResult.UNSUPPORTED, f"item {number}: command {item.command} is none of a fence")
    return tuple(areas)


def items_of(found: Sequence[MavItem]) -> Items:
    """Items as they are sent.

    Raises:
        Refused: one does not fit the wire.
    """
    return tuple(to_wire(item, f"item {number}") for number, item in enumerate(found))
