"""The waypoint controller over a floor that rises: it keeps its height, waits where that is steep, and fails blind."""

import math
from typing import Any

import msgspec
import pytest
from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.messages.frames import Vector3, from_euler
from gloc3.messages.vehicle import DriverState, HeightAboveGround, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3_onboard.algorithms.paths.floor_clearance import FloorClearance
from gloc3_onboard.components.controllers.waypoints import WaypointsController, WaypointsSettings

STEP_S = 0.05
CLIMB_M_S = 0.3


class Rig:
    """A vehicle that does as it is asked, over a floor 10 m below home that rises by a share of the way north."""

    def __init__(self, rise: float = 0.0) -> None:
        self.rise, self.is_blind = rise, False
        self.stage = Stage(WaypointsController(), WaypointsSettings(climb_m_s=CLIMB_M_S, acceleration_m_s2=0.3))
        self.at: Vector3 = (0.0, 0.0, 4.0)
        self.heights: list[float] = []
        self.downs: list[float] = []
        self.run(STEP_S)

    @property
    def height_m(self) -> float:
        return 10.0 - self.rise * max(0.0, self.at[0]) - self.at[2]

    def begin(self) -> None:
        order = FollowWaypointsOrder(
            waypoints_ned_m=((6.0, 0.0, 1.0), (12.0, 0.0, 5.0)), speed_m_s=0.5, altitude_m=2.0, acceptance_m=0.3
        )
        self.stage.begin("follow_waypoints", **msgspec.to_builtins(order))
        self.run(STEP_S)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            messages: dict[str, Any] = {"driver": DriverState(is_guided=True)}
            messages["pose"] = pose(self.at[0], self.at[1], -self.at[2])
            messages["height"] = HeightAboveGround(height_m=self.height_m, is_valid=not self.is_blind)
            for message in self.stage.step(STEP_S, **messages):
                if isinstance(message, Setpoint) and message.position_ned_m is not None:
                    (n, e, d), down = message.position_ned_m, self.at[2]
                    self.at = (n, e, down + min(max(d - down, -CLIMB_M_S * STEP_S), CLIMB_M_S * STEP_S))
                    self.heights.append(self.height_m)
                    self.downs.append(self.at[2])

    def until_ended(self) -> str:
        while self.stage.status.state == "running" and self.stage.now_s < 120.0:
            self.run(STEP_S)
        return f"{self.stage.status.state} {self.stage.status.reason}".strip()


def test_it_goes_down_no_faster_than_it_may_and_stays_at_its_height_whatever_the_waypoints_heights_are() -> None:
    rig = Rig(rise=0.1)
    rig.begin()
    assert rig.until_ended() == "done"
    assert rig.at[0] == pytest.approx(12.0, abs=0.3)
    assert rig.heights[0] > 5.9
    settled = rig.heights[int(18.0 / STEP_S) :]
    assert settled == pytest.approx([2.0] * len(settled), abs=0.15)
    assert max(abs(b - a) for a, b in zip(rig.downs, rig.downs[1:], strict=False)) <= CLIMB_M_S * STEP_S + 1e-9


def test_where_the_floor_rises_faster_than_it_climbs_it_waits_at_half_the_height() -> None:
    rig = Rig(rise=1.2)
    rig.at = (0.0, 0.0, 8.0)
    rig.run(STEP_S)
    rig.begin()
    assert rig.until_ended() == "done", "it takes longer"
    assert min(rig.heights) == pytest.approx(1.0, abs=0.3)
    assert rig.height_m == pytest.approx(2.0, abs=0.4)


def test_without_an_echo_it_keeps_its_depth_and_then_fails_with_the_reason() -> None:
    rig = Rig()
    rig.begin()
    rig.run(16.0)
    rig.is_blind, depth_m = True, rig.at[2]
    assert rig.until_ended().startswith("failed the floor to keep the height over is out of sight")
    assert rig.at[2] == pytest.approx(depth_m, abs=0.1)


def test_a_lean_shortens_the_height_that_the_range_says() -> None:
    clearance = FloorClearance(altitude_m=2.0, drop_m=5.0, climb_m_s=100.0)
    for _ in range(200):
        clearance.update(4.0, from_euler(math.radians(30.0), 0.0, 0.0), (0.0, 0.0, 5.0), 0.1)
    assert clearance.moved((0.0, 0.0, 5.0))[2] == pytest.approx(5.0 + 4.0 * math.cos(math.radians(30.0)) - 2.0)
