"""One survey file, as it is, is driven by the rover, sailed by the boat and dived by the AUV, in virtual time."""

import math
from pathlib import Path
from typing import Any

import pytest
from tests.flight.card import Card

from gloc3.messages.frames import Vector3

MISSION = """\
mission: a line
frame: geo
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  away: {actions: {off: {depart: {}}}}
  area:
    after: [away]
    actions:
      lines: {survey: {area: [[63.4396, 10.3990], [63.4396, 10.39928], [63.43964, 10.39928], [63.43964, 10.3990]], spacing_m: 9}}
  back: {after: [area], actions: {end: {arrive: {}}}}
"""
LINE_M = 14.0
"""From west to east."""


def driven(platform: str, folder: Path, around: dict[str, Any]) -> list[Vector3]:
    """Where it went."""
    card = Card("ardupilot", folder)
    try:
        card.begin(MISSION, platform=platform, **around)
        card.await_state("mission", "done", 300.0)
        assert not card.flight.simulator.autopilot.craft.is_armed, "disarmed at the end"
        return [sample.position_ned_m for sample in card.flight.truth.samples]
    finally:
        card.close()


@pytest.mark.parametrize(
    ("platform", "around", "near_m", "deep_m"),
    [
        ("rover", {"seed": 1}, 0.8, 0.0),
        ("boat", {"waves_m": 0.2, "current_m_s": 0.2}, 2.5, 0.0),
        ("auv", {}, 2.5, 5.0),
    ],
)
def test_a_survey_is_carried_out_in_its_own_way_and_ends_at_home_disarmed(
    platform: str, around: dict[str, Any], near_m: float, deep_m: float, tmp_path: Path
) -> None:
    way = driven(platform, tmp_path, around)
    assert max(east for _, east, _ in way) == pytest.approx(LINE_M, abs=near_m)
    assert max(down for *_, down in way) - way[0][2] == pytest.approx(deep_m, abs=0.6)
    assert math.dist(way[-1], way[0]) < 4.5
