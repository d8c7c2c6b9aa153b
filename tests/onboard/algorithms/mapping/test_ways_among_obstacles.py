"""Controller and limiter together, with a scanner: around a box on the way, along a wall at a distance, and the ends."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from tests.onboard.algorithms.scan_matching.rays import Scanner, Wall, box
from tests.onboard.messages import LIMITS, grant, pose
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3, from_yaw
from gloc3.messages.vehicle import DriverState, ObstacleScan, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder
from gloc3.mission.model.messages import ActionStatus
from gloc3_onboard.algorithms.paths.wall_distance import WallDistance, wall_ahead
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt
from gloc3_onboard.components.controllers.limiter import Limiter
from gloc3_onboard.components.controllers.waypoints import WaypointsController, WaypointsSettings
from gloc3_onboard.sensors.checks.obstacles import obstacles_of

pytestmark = pytest.mark.thorough

STEP_S = 0.05
LAG = 6
"""The vehicle is where its setpoint was so many steps ago."""


class Chain:
    """Waypoint controller, limiter, a vehicle that lags, and a scanner with noise, at 20 and 10 Hz."""

    def __init__(
        self, walls: Callable[[float], list[Wall]], start: Vector3 = (0.0, 0.0, -2.0), yaw_rad: float = 0.0
    ) -> None:
        self.controller, self.limiter = Stage(WaypointsController(), WaypointsSettings()), Stage(Limiter())
        self.walls, self.yaw_rad = walls, yaw_rad
        self.random = np.random.default_rng(1)
        self.places = [start] * LAG
        self.nearest_m = math.inf
        self.now_s = 0.0
        self.limiter.step(STEP_S, limits=LIMITS, grant=grant("go"))
        self.controller.step(STEP_S, pose=self.pose, driver=DriverState(is_guided=True), obstacles=self.poll())

    @property
    def at(self) -> Vector3:
        return self.places[-LAG]

    @property
    def pose(self) -> Any:
        north, east, down = self.at
        before = self.places[max(0, len(self.places) - LAG - 1)]
        velocity = ((north - before[0]) / STEP_S, (east - before[1]) / STEP_S, 0.0)
        return pose(north, east, -down, ned_from_frd=from_yaw(self.yaw_rad), velocity_ned_m_s=velocity)

    def poll(self) -> ObstacleScan:
        scanner, here = Scanner(self.walls(self.now_s), range_max_m=12.0), Planar(self.at[0], self.at[1], self.yaw_rad)
        return obstacles_of(scanner.scan(here, self.random), Tilt(), Mount(), here, Planar(), 2.0)

    def fly(self, waypoints: tuple[Vector3, ...], within_s: float, **order: Any) -> ActionStatus:
        given = FollowWaypointsOrder(waypoints_ned_m=waypoints, **{"speed_m_s": 0.8, **order})
        self.controller.begin("follow_waypoints", **msgspec.to_builtins(given))
        while self.now_s < within_s:
            self.now_s += STEP_S
            messages: dict[str, Any] = {"pose": self.pose, "driver": DriverState(is_guided=True)}
            if round(self.now_s / STEP_S) % 2:
                messages["obstacles"] = self.poll()
                self.nearest_m = min(self.nearest_m, *messages["obstacles"].sectors_m)
            wanted = [found for found in self.controller.step(STEP_S, **messages) if isinstance(found, Setpoint)]
            del messages["driver"]
            for found in self.limiter.step(STEP_S, **messages, **({"setpoint_wanted": wanted[0]} if wanted else {})):
                if isinstance(found, Setpoint) and found.position_ned_m is not None:
                    self.places.append(found.position_ned_m)
                    self.yaw_rad = found.yaw_rad or 0.0
            if self.controller.status.state not in ("running", "paused"):
                break
        return self.controller.status


@pytest.mark.thorough
@pytest.mark.parametrize("size_m", [0.6, 1.6])
def test_a_way_through_a_box_is_flown_around_it(size_m: float) -> None:
    room = [*box(-5.0, -6.0, 20.0, 12.0), *box(5.0 - size_m / 2.0, -size_m / 2.0, size_m, size_m)]
    chain = Chain(lambda _: room)
    status = chain.fly(((10.0, 0.1, -2.0), (10.0, 3.0, -2.0)), 40.0)
    assert (status.state, status.reason) == ("done", "")
    assert chain.nearest_m > 0.84


@pytest.mark.thorough
def test_a_corner_of_the_way_inside_a_box_fails_with_a_reason() -> None:
    room = [*box(-5.0, -6.0, 20.0, 12.0), *box(4.0, -1.0, 2.0, 2.0)]
    chain = Chain(lambda _: room)
    status = chain.fly(((5.0, 0.0, -2.0), (5.0, 4.0, -2.0)), 60.0)
    assert status.state == "failed"
    assert "does not come to waypoint 1" in status.reason
    assert chain.nearest_m > 0.84


@pytest.mark.thorough
def test_a_box_that_crosses_the_way_is_let_pass() -> None:
    chain = Chain(lambda now_s: [*box(-5.0, -8.0, 20.0, 16.0), *box(4.5, 4.0 - 0.5 * min(now_s, 20.0), 0.8, 0.8)])
    assert chain.fly(((10.0, 0.0, -2.0),), 60.0).state == "done"
    assert chain.nearest_m > 0.84


@pytest.mark.thorough
def test_a_distance_to_a_wall_is_kept_that_does_not_run_as_the_way_does() -> None:
    wall: Wall = ((-5.0, 2.1), (25.0, 3.6))  # 2.9 degrees askew
    chain = Chain(lambda _: [wall, *box(-6.0, -8.0, 32.0, 13.0)], yaw_rad=math.pi / 2.0)
    status = chain.fly(
        ((14.0, 0.6, -2.0),), 60.0, wall_distance_m=1.5, heading=HeadingOrder(mode="fixed", heading_rad=math.pi / 2.0)
    )
    assert status.state == "done"
    off = [abs((2.35 + 0.05 * n - e) * math.cos(math.atan(0.05)) - 1.5) for n, e, _ in chain.places if n > 2.0]
    assert max(off) < 0.15


def test_without_a_scanner_no_distance_to_a_wall_is_promised() -> None:
    stage = Stage(WaypointsController(), WaypointsSettings())
    stage.step(STEP_S, pose=pose(), driver=DriverState(is_guided=True))
    order = FollowWaypointsOrder(waypoints_ned_m=((3.0, 0.0, -2.0),), speed_m_s=1.0, wall_distance_m=1.5)
    with pytest.raises(Refused, match="no sensor sees the wall"):
        stage.begin("follow_waypoints", **msgspec.to_builtins(order))


def test_a_wall_is_seen_square_to_itself_and_a_corner_is_none() -> None:
    wall = [(0.1 * number, 2.0 + 0.02 * number) for number in range(-20, 21)]
    found = wall_ahead(wall, (0.0, 0.0, -2.0), math.pi / 2.0)
    assert found is not None
    assert found.distance_m == pytest.approx(2.0 * math.cos(math.atan(0.2)), abs=1e-6)
    assert found.toward_ne == pytest.approx((-math.sin(math.atan(0.2)), math.cos(math.atan(0.2))))
    assert wall_ahead(wall, (0.0, 0.0, -2.0), -math.pi / 2.0) is None
    corner = [(0.1 * number, 1.0 + 0.1 * abs(number)) for number in range(-15, 16)]
    assert wall_ahead(corner, (0.0, 0.0, -2.0), math.pi / 2.0) is None


def test_the_way_is_moved_slowly_and_not_far() -> None:
    distance, wall = (
        WallDistance(1.0),
        wall_ahead([(0.1 * n, 6.0) for n in range(-9, 10)], (0.0, 0.0, -2.0), math.pi / 2.0),
    )
    for _ in range(4):
        distance.update(wall, (0.0, 0.0, -2.0), (0.0, 0.0, -2.0), 0.1)
    assert distance.moved((0.0, 0.0, -2.0)) == pytest.approx((0.0, 0.16, -2.0))
    for _ in range(100):
        distance.update(wall, (0.0, 0.0, -2.0), (0.0, 0.0, -2.0), 0.1)
    assert distance.moved((0.0, 0.0, -2.0)) == pytest.approx((0.0, 1.5, -2.0))
    assert distance.unmoved(distance.moved((1.0, 2.0, -2.0))) == pytest.approx((1.0, 2.0, -2.0))
    distance.update(None, (0.0, 0.0, -2.0), (0.0, 0.0, -2.0), 0.5)
    assert distance.blind_s == 0.5
