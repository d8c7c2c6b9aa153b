"""`flown_by: autopilot` where a platform and a task allow it; else why not, and where."""

import pytest

from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import exported
from gloc3.mission.model.abilities import abilities as abilities_of
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.mission.reading.writer import write_mission
from gloc3.mission.showing.show import drawing
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform

TEXT = """\
mission: by the autopilot
frame: hold
tasks:
  up: {actions: {climb: {take_off: {height_m: 2}}}}
  box:
    after: [up]
    flown_by: autopilot
    actions:
      way: {ACTION}
      pictures: {record_images: {camera: ground, every_s: 1}, until: way}
  end: {after: [box], actions: {down: {land: {}}}}
"""
WAY = "transit: {to_m: [[3, 1], [3, 3]]}"


@pytest.fixture
def pelican() -> Platform:
    return load_platform("pelican_rtk")


def findings(platform: Platform, action: str = WAY) -> list[str]:
    text = TEXT.replace("ACTION", action)
    report = check_text(text, "m", Circumstances(platform=platform, home_ned_m=(0.0, 0.0, 0.0)))
    return [str(finding) for finding in report.findings if not finding.is_warning]


def test_ways_are_flown_as_plans_and_everything_else_as_ever(pelican: Platform) -> None:
    assert not findings(pelican)
    mission = read_mission(TEXT.replace("ACTION", WAY), "m", MissionReferences.of(pelican))
    abilities = {target: action.ability for target, action in mission.actions().items()}
    assert abilities == {
        "up.climb": "take_off",
        "box.way": "fly_plan",
        "box.pictures": "record_images",
        "end.down": "land",
    }
    assert "flown_by: autopilot" in write_mission(mission)
    report = check_text(TEXT.replace("ACTION", WAY), "m", Circumstances(platform=pelican))
    assert "flown by the autopilot" in drawing(report, abilities_of(pelican), pelican)


@pytest.mark.parametrize(
    ("action", "problem"),
    [
        ("hold: {duration_s: 3}", "plans consist of waypoints only"),
        ("go_to: {position_m: [3, 1, 2], heading: {look_at: [0, 0, 1]}}", "a plan cannot express heading 'look at'"),
        (
            "follow_wall: {wall_m: [[0, 3], [6, 3]], side: left, standoff_m: 2, height_m: 1.5, is_measured: true}",
            "it cannot keep a distance from a wall",
        ),
        ("go_to: {position_m: [3, 1, 2], heading: hold}", "a plan cannot express heading 'hold'"),
        ("go_to: {position_m: [3, 1, 2], altitude_m: 2}", "it cannot hold a height above ground"),
    ],
)
def test_what_no_plan_can_say_is_found_at_its_place(pelican: Platform, action: str, problem: str) -> None:
    expected = f"m:9:13: box.way cannot be flown by the autopilot alone: {problem}"
    assert [one.partition(" (")[0].partition("; ")[0] for one in findings(pelican, action)] == [expected]


def test_a_task_that_moves_nothing_and_a_platform_without_plans_are_told() -> None:
    pelican, indoors = load_platform("pelican_rtk"), load_platform("pelican")
    text = TEXT.replace("      way: {ACTION}\n", "").replace(", until: way", "")
    report = check_text(text, "m", Circumstances(platform=pelican))
    reported = [str(finding) for finding in report.findings]
    assert "m:7:15: box has no motion that the autopilot could fly (leave out flown_by)" in reported
    assert any("m:7:15: the autopilot of pelican accepts no plans" in one for one in findings(indoors))


def test_a_dive_is_left_out_of_a_plan_with_a_word() -> None:
    auv = load_platform("auv")
    frame = next(iter(auv.local_frames()))
    actions = "{d: {dive: {depth_m: 4}}, w: {transit: {to_m: [[9, 0]]}, after: [d]}}"
    text = f"mission: m\nframe: {frame}\ntasks: {{a: {{actions: {actions}}}}}\n"
    mission = read_mission(text, "m", MissionReferences.of(auv))
    _, warnings = exported(mission, ".plan", "m", auv.local_frames())
    assert [one.message for one in warnings] == ["a.d is left out: plans have no dive"]
