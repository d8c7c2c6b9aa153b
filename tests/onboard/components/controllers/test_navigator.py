"""Map, planner, navigator and limiter together, with a scanner: goals behind walls, a box that appears, exploring."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from tests.onboard.algorithms.scan_matching.rays import Scanner, Wall, box
from tests.onboard.messages import LIMITS, grant, pose
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3, from_yaw
from gloc3.messages.perception import CELL_FREE, OccupancyMap
from gloc3.messages.vehicle import DriverState, PlannedRoute, Pose, RouteWanted, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder
from gloc3.mission.model.exploring import ExploreOrder
from gloc3.mission.model.fence import Area, Fence
from gloc3.mission.model.messages import ActionStatus
from gloc3_onboard.algorithms.mapping.known_space import cells_of
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt
from gloc3_onboard.components.controllers.limiter import Limiter
from gloc3_onboard.components.controllers.navigator import NavigatorController
from gloc3_onboard.components.controllers.planner import PlannerController
from gloc3_onboard.components.processors.map import MapProcessor, MapSettings
from gloc3_onboard.sensors.checks.obstacles import obstacles_of

STEP_S = 0.05
LAG = 6
"""The vehicle is where its setpoint was so many steps ago."""
KEEP_M = 1.1
"""What the limiter keeps: the planner's routes give it nothing to do."""
ROOM = box(-4.0, -8.0, 20.0, 16.0)
WALL = box(5.0, -8.0, 0.5, 12.0)
"""Leaves a gap of 4 m at the eastern side."""
FENCE = Fence(area=Area(polygon_ne_m=((-3.9, -7.9), (15.9, -7.9), (15.9, 7.9), (-3.9, 7.9))))
GO = FollowWaypointsOrder(waypoints_ned_m=((10.0, -2.0, -2.0),), speed_m_s=1.0, plan=True)


class Voyage:
    """A vehicle that follows its limited setpoints late, at 20 Hz, with a scanner at 10 Hz."""

    def __init__(self, walls: Callable[[float], list[Wall]], range_m: float = 10.0) -> None:
        self.walls, self.yaw_rad, self.now_s = walls, 0.0, 0.0
        self.is_seeing: Callable[[], bool] = lambda: True
        """Whether the scanner lives."""
        self.random = np.random.default_rng(1)
        self.places: list[Vector3] = [(0.0, 0.0, -2.0)] * LAG
        self.nearest_m = math.inf
        self.map = Stage(MapProcessor(), MapSettings(range_m=range_m))
        self.planner, self.navigator = Stage(PlannerController()), Stage(NavigatorController())
        self.limiter = Stage(Limiter())
        self.limits = replace(LIMITS, fence=FENCE, fence_margin_m=0.3)
        self.limiter.step(STEP_S, limits=self.limits, grant=grant("go"))
        self.planner.put(limits=self.limits)
        self.run(lambda: self.now_s >= 2.5)

    @property
    def at(self) -> Vector3:
        return self.places[-LAG]

    @property
    def pose(self) -> Pose:
        north, east, down = self.at
        before = self.places[max(0, len(self.places) - LAG - 1)]
        velocity = ((north - before[0]) / STEP_S, (east - before[1]) / STEP_S, 0.0)
        return pose(north, east, -down, ned_from_frd=from_yaw(self.yaw_rad), velocity_ned_m_s=velocity)

    def run(self, is_over: Callable[[], bool], within_s: float = 200.0) -> None:
        until_s = self.now_s + within_s
        while not is_over() and self.now_s < until_s:
            self._step()

    def _step(self) -> None:
        self.now_s = round(self.now_s + STEP_S, 6)
        seen: dict[str, Any] = {"pose": self.pose}
        if round(self.now_s / STEP_S) % 2:
            here = Planar(self.at[0], self.at[1], self.yaw_rad)
            scan = Scanner(self.walls(self.now_s), range_max_m=30.0).scan(here, self.random)
            scanned = obstacles_of(scan, Tilt(), Mount(), here, Planar(), 2.0)
            self.nearest_m = min(self.nearest_m, *scanned.sectors_m)
            laser = {"laser": scan} if self.is_seeing() else {}
            seen |= {"obstacles": scanned} if self.is_seeing() else {}
            for found in self.map.step(2.0 * STEP_S, pose=self.pose, **laser):
                self.planner.put(self.map.valid_s[OccupancyMap], map=found)
                self.navigator.put(self.map.valid_s[OccupancyMap], map=found)
        self.planner.now_s = self.now_s - STEP_S
        for route in self.planner.step(STEP_S, pose=self.pose):
            self.navigator.put(route=route)
        self.navigator.now_s = self.now_s - STEP_S
        wanted: dict[str, Any] = {}
        for told in self.navigator.step(STEP_S, pose=self.pose, driver=DriverState(is_guided=True)):
            if isinstance(told, RouteWanted):
                self.planner.put(route_wanted=told)
            elif isinstance(told, Setpoint):
                wanted = {"setpoint_wanted": told}
        self.limiter.now_s = self.now_s - STEP_S
        for told in self.limiter.step(STEP_S, **seen, **wanted):
            if isinstance(told, Setpoint) and told.position_ned_m is not None:
                self.places.append(told.position_ned_m)
                self.yaw_rad = told.yaw_rad or 0.0

    def begin(self, order: FollowWaypointsOrder | ExploreOrder) -> None:
        capability = "explore" if isinstance(order, ExploreOrder) else "find_way"
        self.navigator.begin(capability, **msgspec.to_builtins(order))

    def fly(self, order: FollowWaypointsOrder | ExploreOrder, within_s: float = 200.0) -> ActionStatus:
        self.begin(order)
        self._step()
        self.run(lambda: self.navigator.status.state not in ("running", "paused"), within_s)
        return self.navigator.status


def test_a_goal_behind_a_wall_is_reached_without_coming_near_to_anything() -> None:
    voyage = Voyage(lambda _: [*ROOM, *WALL])
    status = voyage.fly(GO)
    assert (status.state, status.reason) == ("done", "")
    assert math.dist(voyage.at, (10.0, -2.0, -2.0)) < 0.3
    assert voyage.nearest_m >= KEEP_M


def test_a_box_that_appears_on_the_route_is_gone_around_by_another_one() -> None:
    def walls(now_s: float) -> list[Wall]:
        return [*ROOM, *(box(4.0, -1.0, 1.5, 2.0) if now_s > 5.0 else [])]

    voyage = Voyage(walls)
    status = voyage.fly(replace(GO, waypoints_ned_m=((10.0, 0.0, -2.0),), speed_m_s=0.6))
    routes = voyage.planner.all(PlannedRoute)
    assert (status.state, status.reason) == ("done", "")
    assert len(routes[0].waypoints_ned_m) == 1
    assert len(routes) > 1
    assert voyage.nearest_m >= KEEP_M - 0.15


def test_a_way_that_is_shut_on_the_way_fails_with_its_reason_in_a_hover() -> None:
    voyage = Voyage(lambda now_s: [*ROOM, *WALL, *(box(5.0, 4.0, 0.5, 4.0) if now_s > 6.0 else [])])
    status = voyage.fly(GO)
    assert status.state == "failed"
    assert status.reason == "no way leads to the goal that keeps 1.3 m from everything"
    assert voyage.nearest_m >= KEEP_M - 0.15
    assert math.dist(voyage.places[-1], voyage.places[-20]) < 0.1


def test_a_goal_too_near_to_a_wall_fails_at_once_with_its_reason() -> None:
    voyage = Voyage(lambda _: [*ROOM, *WALL])
    status = voyage.fly(replace(GO, waypoints_ned_m=((4.5, -2.0, -2.0),)), 30.0)
    assert status.state == "failed"
    assert "from something, and 1.3 m are kept" in status.reason
    assert math.dist(voyage.at, (0.0, 0.0, -2.0)) < 0.1


def test_a_paused_flight_goes_on_from_where_the_vehicle_then_is() -> None:
    voyage = Voyage(lambda _: [*ROOM, *WALL])
    voyage.begin(GO)
    voyage.run(lambda: voyage.now_s > 6.0)
    voyage.navigator.call("action.pause", action_id="go")
    voyage.run(lambda: voyage.now_s > 8.0)
    voyage.navigator.call("action.resume", action_id="go")
    voyage.run(lambda: voyage.now_s > 9.0)
    voyage.run(lambda: voyage.navigator.status.state != "running")
    assert voyage.navigator.status.state == "done"
    assert voyage.navigator.last(RouteWanted).request == 2


def test_a_way_is_not_flown_on_without_scans_and_fails_with_the_reason_in_a_hover() -> None:
    voyage = Voyage(lambda now_s: [*ROOM, *(WALL if now_s > 4.0 else [])])
    voyage.is_seeing = lambda: voyage.now_s < 4.0
    status = voyage.fly(replace(GO, speed_m_s=0.6))
    assert (status.state, status.reason) == ("failed", "the map has no scan of the last 2.5 s")
    assert voyage.now_s == pytest.approx(4.0 + 2.5 + 8.0, abs=0.3)
    assert voyage.nearest_m >= KEEP_M
    assert math.dist(voyage.places[-1], voyage.places[-20]) < 0.01


def test_a_way_goes_on_by_another_route_when_the_scans_come_back() -> None:
    voyage = Voyage(lambda now_s: [*ROOM, *(WALL if now_s > 4.0 else [])])
    voyage.is_seeing = lambda: not 4.0 < voyage.now_s < 9.0
    assert voyage.fly(replace(GO, speed_m_s=0.6)).state == "done"
    assert voyage.navigator.last(RouteWanted).request == 2
    assert voyage.nearest_m >= KEEP_M


@pytest.mark.parametrize("after_s", [0.0, 0.5, 1.0])
def test_an_exploration_that_sees_nothing_new_from_a_viewpoint_is_not_complete(after_s: float) -> None:
    voyage = Voyage(lambda _: [*ROOM, *WALL], range_m=5.0)
    voyage.begin(ExploreOrder(down_m=-2.0, speed_m_s=1.0, duration_s=300.0))
    voyage.run(lambda: getattr(voyage.navigator.component, "_arrived_s") is not None)  # noqa: B009
    lost_s = voyage.now_s + after_s
    voyage.is_seeing = lambda: voyage.now_s < lost_s
    voyage.run(lambda: voyage.navigator.status.state != "running")
    status = voyage.navigator.status
    assert (status.state, status.reason) == ("failed", "the map has no scan of the last 2.5 s")


def test_a_hover_in_a_room_that_does_not_change_is_not_blind() -> None:
    voyage = Voyage(lambda _: ROOM)
    voyage.begin(replace(GO, waypoints_ned_m=((3.0, 0.0, -2.0),)))
    voyage.run(lambda: voyage.now_s > 4.0)
    voyage.navigator.call("action.pause", action_id="go")
    voyage.run(lambda: voyage.now_s > 30.0)
    voyage.navigator.call("action.resume", action_id="go")
    voyage.run(lambda: voyage.navigator.status.state in ("done", "failed"))
    assert voyage.navigator.status.state == "done"
    assert voyage.navigator.last(RouteWanted).request == 2


@pytest.mark.thorough
def test_an_exploration_sees_nearly_all_of_the_floor_that_can_be_seen() -> None:
    walls = [*ROOM, *WALL, *box(10.0, 4.0, 1.0, 1.0)]
    voyage = Voyage(lambda _: walls, range_m=6.0)
    status = voyage.fly(ExploreOrder(down_m=-2.0, speed_m_s=1.0, duration_s=300.0), 300.0)
    assert status.state == "done"
    assert "of the area is known" in status.reason
    found = voyage.map.last(OccupancyMap)
    free = (cells_of(found) == CELL_FREE).any(axis=0)
    assert np.count_nonzero(free) * found.cell_m**2 >= 0.95 * (20.0 * 16.0 - 12.0 * 0.5 - 1.0)
    assert voyage.nearest_m >= KEEP_M


def test_an_exploration_ends_when_its_time_is_over() -> None:
    voyage = Voyage(lambda _: [*ROOM, *WALL], range_m=6.0)
    status = voyage.fly(ExploreOrder(down_m=-2.0, speed_m_s=1.0, duration_s=5.0))
    assert (status.state, status.reason) == ("done", "its 5 s are over")
    assert voyage.now_s == pytest.approx(7.5, abs=0.2)


def test_without_a_map_or_a_pose_it_refuses_and_it_plans_to_one_place_at_a_time() -> None:
    voyage = Voyage(lambda _: ROOM)
    with pytest.raises(Refused, match="one place at a time"):
        voyage.begin(replace(GO, waypoints_ned_m=(*GO.waypoints_ned_m, (3.0, 0.0, -2.0))))
    with pytest.raises(Refused, match="a planned way cannot hold at waypoints"):
        voyage.begin(replace(GO, hold_s=2.0))
    with pytest.raises(Refused, match="a planned way cannot choose its heading: heading hold"):
        voyage.begin(replace(GO, heading=HeadingOrder(mode="hold")))
    stage = Stage(NavigatorController())
    stage.step()
    with pytest.raises(Refused, match="there is no valid pose"):
        stage.begin("find_way", **msgspec.to_builtins(GO))
    stage.step(pose=pose())
    with pytest.raises(Refused, match="there is no map to plan in"):
        stage.begin("find_way", **msgspec.to_builtins(GO))


def test_a_planner_that_does_not_answer_is_told() -> None:
    voyage = Voyage(lambda _: ROOM)
    voyage.begin(GO)
    for _ in range(200):
        voyage.navigator.put(map=voyage.map.last(OccupancyMap))
        voyage.navigator.step(STEP_S, pose=voyage.pose, driver=DriverState(is_guided=True))
    assert (voyage.navigator.status.state, voyage.navigator.status.reason) == ("failed", "the planner does not answer")
