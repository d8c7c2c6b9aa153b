"""One mission file is driven by the rover and sailed by the boat, in virtual time."""

import math
from pathlib import Path
from typing import Any

import pytest
from tests.flight.card import Card

MISSION = """\
mission: there and back
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  away: {actions: {off: {depart: {}}}}
  box:
    after: [away]
    actions:
      way: {follow_waypoints: {waypoints_m: [[14, 0, 0], [14, -9, 0]], speed_m_s: 1.5, acceptance_m: 2.5}}
  back: {after: [box], actions: {end: {arrive: {}}}}
"""


def driven(platform: str, folder: Path, around: dict[str, Any]) -> list[tuple[float, float]]:
    """Where it went, on the map."""
    card = Card("ardupilot", folder)
    try:
        card.begin(MISSION, platform=platform, **around)
        card.await_state("mission", "done", 120.0)
        assert not card.flight.simulator.autopilot.craft.is_armed, "disarmed at the end"
        return [(sample.position_ned_m[0], sample.position_ned_m[1]) for sample in card.flight.samples]
    finally:
        card.close()


@pytest.mark.parametrize(
    ("platform", "around", "near_m"),
    [("rover", {}, 0.6), ("boat", {"waves_m": 0.2, "current_m_s": 0.2}, 2.5)],
)
def test_a_mission_is_carried_out_and_ends_at_home_disarmed(
    platform: str, around: dict[str, Any], near_m: float, tmp_path: Path
) -> None:
    way = driven(platform, tmp_path, around)
    for place in ((14.0, 0.0), (14.0, 9.0)):
        assert min(math.dist(at, place) for at in way) < near_m
    assert math.dist(way[-1], way[0]) < 4.5
