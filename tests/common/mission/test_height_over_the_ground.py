"""`altitude_m`: it comes to the component as it is written, and is refused where nobody can keep it."""

import pytest

from gloc3.errors import InputError
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import exported
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.platform.reader import load_platform

TEXT = """\
mission: over the floor
frame: FRAME
tasks:
  away: {actions: {off: {depart: {}}}}
  low:
    after: [away]
    actions:
      way: {ACTION}
  end: {after: [low], actions: {home: {arrive: {}}}}
"""
WAYS = (
    "go_to: {position_m: [9, 0, -4], altitude_m: 2.5}",
    "follow_waypoints: {waypoints_m: [[9, 0, -4], [9, 5, -4]], altitude_m: 2.5}",
    "survey: {area_m: [[0, 0], [20, 0], [20, 8]], spacing_m: 4, altitude_m: 2.5}",
    "transit: {to_m: [[9, 0]], altitude_m: 2.5}",
)


def findings(platform: str, action: str) -> list[str]:
    found = load_platform(platform)
    frame = next(iter(found.local_frames()))
    text = TEXT.replace("ACTION", action).replace("FRAME", frame)
    report = check_text(text, "m", Circumstances(platform=found, home_ned_m=(0.0, 0.0, 0.0)))
    return [str(finding) for finding in report.findings if not finding.is_warning]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("platform", ["rov", "auv"])
def test_every_way_can_keep_a_height_over_the_floor(platform: str, way: str) -> None:
    assert not findings(platform, way)
    text = TEXT.replace("ACTION", way).replace("FRAME", "bay")
    order = read_mission(text, "m", MissionReferences.of(load_platform(platform))).actions()["low.way"].order
    assert isinstance(order, FollowWaypointsOrder)
    assert order.altitude_m == 2.5


def test_one_that_is_too_low_for_the_platform_is_found_at_its_place() -> None:
    way = "transit: {to_m: [[9, 0]], altitude_m: 1}"
    (found,) = findings("auv", way)
    assert found.startswith("m:8:51: 1 m above ground is below the platform's limit of 2 m")
    assert not findings("rov", way)


@pytest.mark.parametrize("platform", ["rover", "submarine"])
def test_a_platform_that_hears_of_no_height_cannot_keep_one(platform: str) -> None:
    found = findings(platform, "transit: {to_m: [[9, 0]], altitude_m: 2}")
    assert any(f"waypoints of {platform} cannot hold a height above ground: it receives none" in one for one in found)


def test_a_plan_of_the_autopilots_cannot_say_it() -> None:
    text = TEXT.replace("ACTION", WAYS[2]).replace("FRAME", "bay")
    mission = read_mission(text, "m", MissionReferences.of(load_platform("auv")))
    with pytest.raises(InputError, match="a plan cannot hold a height above ground"):
        exported(mission, ".plan", "m", load_platform("auv").local_frames())
