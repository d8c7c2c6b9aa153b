"""Routes in a known map: around what is there, never nearer than the distance to keep, and why there is none."""

import math
import zlib
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from tests.onboard.messages import LIMITS

from gloc3.messages.frames import Vector3
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, OccupancyMap
from gloc3.messages.vehicle import MotionLimits, PlannedRoute, RouteWanted
from gloc3.mission.model.fence import Area, Fence
from gloc3_onboard.algorithms.mapping.occupancy import OccupancyStack
from gloc3_onboard.algorithms.mapping.route_planner import RoutePlanner

Block = tuple[float, float, float, float]
"""Least north and east, greatest north and east."""
KEEP_M = 1.0
START: Vector3 = (0.0, 0.0, -2.0)
WALL: Block = (4.0, -6.0, 4.4, 3.0)
"""With a gap of 3 m at its eastern end."""


def mapped(*blocks: Block, unknown: Sequence[Block] = (), levels: Sequence[int] = (3, 4)) -> OccupancyMap:
    """A room of 12 by 12 m, its walls and blocks occupied, everything else free."""
    north, east = (np.arange(-40, 100) * 0.1 + 0.05)[:, None], (np.arange(-70, 70) * 0.1 + 0.05)[None, :]
    states = np.full((140, 140), CELL_FREE, np.uint8)
    states[:1], states[-1:], states[:, :1], states[:, -1:] = (CELL_OCCUPIED,) * 4
    for state, given in ((CELL_UNKNOWN, unknown), (CELL_OCCUPIED, blocks)):
        for n0, e0, n1, e1 in given:
            states[(north > n0) & (north < n1) & (east > e0) & (east < e1)] = state
    cells = zlib.compress(np.stack([states] * len(levels)).tobytes())
    return OccupancyMap(
        corner_ne_m=(-4.0, -7.0), cell_m=0.1, rows=140, columns=140, layer_m=0.5, levels=list(levels), cells=cells
    )


def wanted(north: float, east: float, request: int = 1, down_m: float = -2.0) -> RouteWanted:
    return RouteWanted(action_id="go", request=request, down_m=down_m, goal_ne_m=(north, east))


def planned(
    known: OccupancyMap, goal: RouteWanted, limits: MotionLimits | None = None, at: Vector3 = START
) -> PlannedRoute:
    found = RoutePlanner(KEEP_M, 4.0).plan(goal, known, at, limits)
    assert found is not None
    return found


def gap_m(route: Sequence[Vector3], blocks: Sequence[Block], start: Vector3 = START) -> float:
    """The least distance of a route from any block."""
    least = math.inf
    for a, b in pairwise([start, *route]):
        for share in np.linspace(0.0, 1.0, 200):
            n, e = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            for n0, e0, n1, e1 in blocks:
                least = min(least, math.hypot(max(n0 - n, 0.0, n - n1), max(e0 - e, 0.0, e - e1)))
    return least


def test_a_route_leads_around_a_wall_and_keeps_its_distance() -> None:
    found = planned(mapped(WALL), wanted(8.0, 0.0))
    assert found.waypoints_ned_m[-1] == (8.0, 0.0, -2.0)
    assert 1 < len(found.waypoints_ned_m) <= 5
    assert gap_m(found.waypoints_ned_m, [WALL]) >= KEEP_M
    length_m = sum(math.dist(a, b) for a, b in pairwise([START, *found.waypoints_ned_m]))
    shortest_m = 2.0 * math.hypot(4.2, 4.0)
    assert length_m < 1.15 * shortest_m


def test_without_anything_in_between_it_is_straight() -> None:
    assert planned(mapped(), wanted(8.0, 3.0)).waypoints_ned_m == [(8.0, 3.0, -2.0)]


def test_what_is_at_other_heights_is_not_in_the_way_but_on_the_way_up_it_is() -> None:
    known = mapped((4.0, -6.9, 4.4, 6.9), levels=(0, 1))
    assert len(planned(known, wanted(8.0, 0.0)).waypoints_ned_m) == 1
    assert "no way leads to the goal" in planned(known, wanted(8.0, 0.0, down_m=-0.5)).reason


@pytest.mark.parametrize(
    ("blocks", "goal", "limits", "why"),
    [
        ([(4.0, -7.0, 4.4, 7.0)], (8.0, 0.0), None, "no way leads to the goal that keeps 1 m from everything"),
        ([(4.0, -6.9, 4.4, 5.2)], (8.0, 0.0), None, "no way leads to the goal"),  # a gap of 1.7 m
        ([WALL], (4.9, 0.0), None, "the goal is 0.5 m from something, and 1 m are kept"),
        ([], (8.0, 0.0), Fence(area=Area(polygon_ne_m=((-3, -6), (6, -6), (6, 6), (-3, 6)))), "outside the fence"),
    ],
)
def test_where_no_way_leads_the_reason_is_told(
    blocks: list[Block], goal: tuple[float, float], limits: Fence | None, why: str
) -> None:
    found = planned(mapped(*blocks), wanted(*goal), replace(LIMITS, fence=limits))
    assert found.waypoints_ned_m == []
    assert why in found.reason


def test_keep_out_areas_and_the_margin_of_the_fence_are_gone_around() -> None:
    keep_out = Area(center_ne_m=(4.0, 0.0), radius_m=2.0)
    found = planned(mapped(), wanted(8.0, 0.0), replace(LIMITS, fence=Fence(keep_out=(keep_out,)), fence_margin_m=0.5))
    legs = pairwise([START, *found.waypoints_ned_m])
    assert min(keep_out.leg_distance_m(a[:2], b[:2]) for a, b in legs) >= 0.5


def test_through_what_is_unknown_a_way_is_tried_where_the_known_one_is_much_longer() -> None:
    known = mapped((4.0, -6.9, 4.4, -2.0), (4.0, 2.0, 4.4, 3.0), unknown=[(3.0, -2.0, 5.5, 2.0)])
    found = planned(known, wanted(8.0, 0.0))
    assert max(abs(east) for _, east, _ in found.waypoints_ned_m) < 2.0


def test_a_box_that_appears_in_the_route_brings_another_one_and_beside_it_none() -> None:
    planner = RoutePlanner(KEEP_M, 4.0)
    first = planner.plan(wanted(8.0, 0.0), mapped(WALL), START, LIMITS)
    assert first is not None
    assert planner.plan(wanted(8.0, 0.0), mapped(WALL), START, LIMITS) is None
    aside: Block = (0.0, -5.0, 1.0, -4.0)
    assert planner.plan(wanted(8.0, 0.0), mapped(WALL, aside), START, LIMITS) is None
    north, east, _ = first.waypoints_ned_m[0]
    box = (0.5 * north - 0.3, 0.5 * east - 0.3, 0.5 * north + 0.3, 0.5 * east + 0.3)
    second = planner.plan(wanted(8.0, 0.0), mapped(WALL, box), START, LIMITS)
    assert second is not None
    assert second.number == first.number + 1
    assert gap_m(second.waypoints_ned_m, [WALL, box]) >= KEEP_M
    passed = planner.plan(wanted(8.0, 0.0), mapped(WALL, box, (-1.0, -1.0, 0.0, 0.0)), (6.0, 3.5, -2.0), LIMITS)
    assert passed is None, "what is behind the vehicle is not in its way"


def test_a_route_that_ends_is_told_once_and_again_for_another_request() -> None:
    planner, closed = RoutePlanner(KEEP_M, 4.0), mapped((4.0, -7.0, 4.4, 7.0))
    first = planner.plan(wanted(8.0, 0.0), closed, START, LIMITS)
    assert first is not None
    assert first.reason
    assert planner.plan(wanted(8.0, 0.0), closed, START, LIMITS) is None
    again = planner.plan(wanted(8.0, 0.0, request=2), closed, START, LIMITS)
    assert again is not None
    assert again.request == 2
    opened = planner.plan(wanted(8.0, 0.0, request=2), mapped(WALL), START, LIMITS)
    assert opened is not None
    assert opened.waypoints_ned_m


def test_from_too_near_it_first_goes_away() -> None:
    at = (3.6, 0.0, -2.0)  # 0.4 m from the wall
    found = planned(mapped(WALL), wanted(0.0, 5.0), at=at)
    assert found.waypoints_ned_m
    assert gap_m(found.waypoints_ned_m, [WALL], at) >= 0.35


def explore(request: int, area: Sequence[tuple[float, float]] = ()) -> RouteWanted:
    return RouteWanted(action_id="see", request=request, down_m=-2.0, area_ne_m=tuple(area))


def test_an_exploration_goes_to_a_place_with_a_view_of_what_is_unknown_and_ends_when_all_is_seen() -> None:
    planner, hidden, wall = RoutePlanner(KEEP_M, 4.0), (4.4, -6.9, 9.9, 3.0), (4.0, -7.0, 4.4, 3.0)
    area = [(-3.9, -6.9), (9.9, -6.9), (9.9, 6.9), (-3.9, 6.9)]
    found = planner.plan(explore(1, area), mapped(wall, unknown=[hidden]), START, LIMITS)
    assert found is not None
    assert not found.is_complete
    assert found.progress == pytest.approx(1.0 - 5.5 * 9.9 / (13.8 * 13.8), abs=0.03)
    north, east, _ = found.waypoints_ned_m[-1]
    assert math.dist((north, east), (7.0, 3.0)) < 4.0
    assert gap_m(found.waypoints_ned_m, [wall]) >= KEEP_M
    assert planner.plan(explore(1, area), mapped(wall, unknown=[hidden]), START, LIMITS) is None
    done = planner.plan(explore(1, area), mapped(wall), START, LIMITS)
    assert done is not None
    assert (done.is_complete, done.waypoints_ned_m) == (True, [])
    assert done.reason == "100% of the area is known"


def test_a_frontier_that_stays_when_it_was_looked_at_is_given_up() -> None:
    planner, known = RoutePlanner(KEEP_M, 4.0), mapped(unknown=[(9.0, -0.5, 9.9, 0.5)])
    area = [(-3.9, -6.9), (9.9, -6.9), (9.9, 6.9), (-3.9, 6.9)]
    first = planner.plan(explore(1, area), known, START, LIMITS)
    assert first is not None
    at = first.waypoints_ned_m[-1]
    second = planner.plan(explore(2, area), known, at, LIMITS)
    assert second is not None
    assert second.is_complete
    assert "; 1 place cannot be seen" in second.reason


def test_neither_an_area_nor_a_fence_is_a_reason_and_so_is_a_damaged_map() -> None:
    assert "neither an area" in planned(mapped(), explore(1), LIMITS).reason
    damaged = replace(mapped(), cells=zlib.compress(b"few"))
    assert "3 cells in place of" in planned(damaged, wanted(8.0, 0.0)).reason


def test_a_map_that_is_known_already_is_planned_in_before_anything_is_seen() -> None:
    stack = OccupancyStack(0.1, 0.5)
    stack.add_map(mapped(WALL))
    found = stack.message(2.0)
    assert found.layers() == mapped(WALL).layers()
    assert gap_m(planned(found, wanted(8.0, 0.0)).waypoints_ned_m, [WALL]) >= KEEP_M
