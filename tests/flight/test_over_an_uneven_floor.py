"""The ROV keeps a height over a floor that rises and falls, by its echo sounder."""

from pathlib import Path

import pytest

from gloc3.clock import run_virtual
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

WORLD = """\
world: reef
based_on: bay
water: {surface_m: 0, floor_m: -8}
boxes:
  shelf: {min_m: [6, -20, -8], max_m: [9, 20, -6.8], texture: sand}
  ridge: {min_m: [9, -20, -8], max_m: [12, 20, -6.0], texture: sand}
"""
MISSION = """\
mission: over the reef
frame: bay
on_failure: land
on_pose_lost: land
tasks:
  down: {actions: {dive: {dive: {depth_m: 3}}}}
  over:
    after: [down]
    actions:
      line: {go_to: {position_m: [18, 0, -3], altitude_m: 2, speed_m_s: 0.35}}
  up: {after: [over], actions: {surface: {land: {}}}}
"""


async def dived(folder: Path) -> list[tuple[float, float]]:
    """Where it was along its line, and how high over the floor."""
    (folder / "reef.yaml").write_text(WORLD)
    (folder / "mission.yaml").write_text(MISSION)
    plan = FlightPlan(mission=str(folder / "mission.yaml"), platform="rov", seed=3, world=str(folder / "reef.yaml"))
    heights: list[tuple[float, float]] = []
    async with Flight(plan) as flight:
        status = f"{flight.name}/action_status/waypoints"
        flight.exchange.subscribe(
            status,
            lambda _: heights.append(
                (flight.truth.samples[-1].position_ned_m[0], flight.simulator.truth().height_above_ground_m)
            ),
        )
        end = await flight.await_end(await flight.upload_and_start(), within_s=400.0)
    assert (str(end.state), end.reason) == ("done", "")
    return heights


def test_it_goes_up_before_a_ridge_and_down_behind_it_at_the_height_that_it_was_told(tmp_path: Path) -> None:
    heights = run_virtual(dived(tmp_path))
    assert min(height for _, height in heights) > 0.6, "where a step of 1.2 m takes it by surprise"
    for begin_m, end_m in ((4.5, 5.9), (8.0, 8.9), (16.2, 17.0)):
        settled = [height for along_m, height in heights if begin_m < along_m < end_m]
        assert settled, f"from {begin_m} m on"
        assert settled == pytest.approx([2.0] * len(settled), abs=0.3), f"from {begin_m} m on"
