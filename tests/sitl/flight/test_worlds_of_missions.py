"""The world in which a mission is simulated: that of the vehicle, at the origin of the mission's frame."""

from itertools import pairwise

import numpy as np
import pytest

from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.templates import mission_from
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.mission_file import place_for
from gloc3_sitl.world import World

MISSION = """\
mission: at a place
frame: FRAME
tasks:
  away: {actions: {off: {depart: {}}}}
"""


@pytest.mark.parametrize(
    ("name", "vehicle", "frame", "world"),
    [
        ("auv", "auv", "bay", "bay"),
        ("rov", "rov", "bay", "bay"),
        ("boat", "boat", "site", "open"),
        ("pelican_rtk", "pelican", "hold", "hold"),
    ],
)
def test_a_local_frame_has_the_vehicles_world_with_its_floor(name: str, vehicle: str, frame: str, world: str) -> None:
    platform = load_platform(name)
    mission = check_text(MISSION.replace("FRAME", frame), "m", Circumstances(platform=platform)).mission
    assert mission is not None
    assert place_for(mission, platform, vehicle).world == world


@pytest.mark.parametrize("template", ["transit", "survey", "patrol", "inspection"])
def test_a_template_leads_through_free_space_of_the_hold(template: str) -> None:
    platform, world = load_platform("pelican"), World.load("hold")
    text = mission_from(template, platform, "x.json")
    mission = check_text(text, template, Circumstances(platform=platform)).mission
    assert mission is not None
    orders = [action.arguments for action in mission.actions().values()]
    places = [place for order in orders for name in ("to_m", "area_m", "wall_m") for place in getattr(order, name, ())]
    assert places
    for begin, end in pairwise([(0.0, 0.0), *places, (0.0, 0.0)]):
        for x, y in np.linspace(begin, end, 100).tolist():
            assert world.geometry.surface_clearance_m((x, y, 1.5)) > 1.1, f"({x:.1f}, {y:.1f}) is too near to a wall"
