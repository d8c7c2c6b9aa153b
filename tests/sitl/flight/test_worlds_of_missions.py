"""The world in which a mission is simulated: that of the vehicle, at the origin of the mission's frame."""

import pytest

from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.mission_file import place_for

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
