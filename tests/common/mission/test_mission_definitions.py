"""Tasks are defined once and used often, with values for what they leave open, in the mission's file or in libraries."""

from pathlib import Path

import pytest

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.formats import mission_text
from gloc3.mission.model.model import Mission
from gloc3.mission.reading.library import bundled
from gloc3.mission.reading.reader import MissionReferences, load_mission, read_mission
from gloc3.mission.reading.writer import write_mission
from gloc3.mission.showing.cli import app

HERE = MissionReferences(frames={"hold": LocalFrame(GeoPoint(39.5, 2.6, 5.0))})
LIBRARY = """\
define:
  lane:
    parameters:
      begin: {kind: point}
      end: {kind: point}
      speed: {kind: number, unit: m/s, default: 0.5, at_least: 0.1}
    deadline_s: 100
    actions:
      to:   {go_to: {position_m: $begin}}
      fly:  {go_to: {position_m: $end, speed_m_s: "${speed}"}, after: [to]}
"""
MISSION = """\
mission: lanes
frame: hold
include: [lanes.yaml]   # what every hold needs
tasks:
  depart: {actions: {up: {take_off: {height_m: 2}}}}
  east: {use: lane, with: {begin: [1, 2, 3], end: [4, 5, 2]}, after: [depart]}
  west: {use: lane, with: {begin: [6, 2, 3], end: [4, 5, 2], speed: 1.5}, after: [east], deadline_s: 50}
"""


@pytest.fixture
def lanes(tmp_path: Path) -> Path:
    (tmp_path / "lanes.yaml").write_text(LIBRARY)
    (tmp_path / "m.yaml").write_text(MISSION)
    return tmp_path / "m.yaml"


def read(text: str) -> Mission:
    return read_mission(text, "m.yaml", HERE)


def own(text: str) -> str:
    """The mission with the library's definitions in its own file."""
    return text.replace("include: [lanes.yaml]   # what every hold needs\n", LIBRARY)


def found(text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(text)
    return [str(finding) for finding in caught.value.findings]


def test_each_use_becomes_a_task_with_its_own_values_and_what_it_says_itself_goes_before_the_definition() -> None:
    mission = read(own(MISSION))
    east, west = mission.tasks["east"], mission.tasks["west"]
    assert east.actions["fly"].arguments.speed_m_s == 0.5  # type: ignore[attr-defined]
    assert west.actions["fly"].arguments.speed_m_s == 1.5  # type: ignore[attr-defined]
    assert west.actions["to"].arguments.position_m == (6, 2, 3)  # type: ignore[attr-defined]
    assert (east.options.deadline_s, west.options.deadline_s) == (100, 50)
    assert west.options.after == ("east",)
    assert read(write_mission(mission)) == mission


def test_a_mission_carries_its_libraries_with_it_and_every_line_stays_where_it_was(lanes: Path) -> None:
    _, text, _ = mission_text(str(lanes))
    assert read(text) == load_mission(str(lanes), HERE) == read(own(MISSION))
    assert text.splitlines()[3:] == MISSION.splitlines()[3:]
    block = MISSION.replace("include: [lanes.yaml]   # what", "include:\n  - lanes.yaml\n# what")
    carried = bundled(block, lanes)
    assert read(carried) == read(text)
    assert carried.count("\n") == block.count("\n")


def test_a_finding_in_a_used_task_names_the_place_of_the_value_and_that_of_the_definition(lanes: Path) -> None:
    lanes.write_text(MISSION.replace("speed: 1.5", "speed: 99"))
    (lanes.parent / "lanes.yaml").write_text(LIBRARY.replace("position_m: $begin", "position_m: $begin, hurry: 1"))
    _, text, _ = mission_text(str(lanes))
    with pytest.raises(InputError) as caught:
        read_mission(text, str(lanes), HERE)
    shown = [str(finding).replace(f"{lanes.parent}/", "") for finding in caught.value.findings]
    assert "m.yaml:7:69: speed_m_s: expected a number <= 50.0 (99) ('speed' of 'lane', lanes.yaml:2:3)" in shown
    hurry = "lanes.yaml:9:42: unknown key 'hurry' (in 'east', m.yaml:6:9) (known: acceptance_m, altitude_m, by, "
    assert [one for one in shown if one.startswith(hurry)]
    assert any("(in 'west', m.yaml:7:9)" in one for one in shown)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("use: lane, with: {begin: [1", "use: lain, with: {begin: [1", "nothing is defined as 'lain' (did you mean 'lane'?)"),
        ("end: [4, 5, 2]}, after: [dep", "stop: [4, 5, 2]}, after: [dep", "'lane' needs 'end', a point: [x, y]"),
        ("speed: 1.5", "sped: 1.5", "'lane' has no parameter 'sped' (it is defined at m.yaml:4:3) (did you mean 'speed'?)"),
        ("speed: 1.5", "speed: fast", "speed: 'fast' is not a number in m/s (it is defined at m.yaml:4:3)"),
        ("speed: 1.5", "speed: 0.01", "speed: 0.01 is below the minimum of 0.1"),
        ("end: [4, 5, 2], sp", "end: 4, sp", "end: '4' is not a point"),
        ("position_m: $begin", "position_m: $start", "'lane' has no parameter 'start'"),
        ('"${speed}"', '"${speed} m/s"', "a parameter inside the text '${speed} m/s' (a parameter stands for a whole value)"),
        ("with: {begin: [6, 2, 3]", "actions: {}, with: {begin: [6, 2, 3]", "'west' has both use and actions"),
        ("default: 0.5", "default: slow", "speed: 'slow' is not a number in m/s"),
        ("{kind: point}\n      end", "{kind: place}\n      end", "'place' is not possible here"),
        ("    actions:\n      to:", "    action:\n      to:", "unknown key 'action'"),
        ("depart: {actions: {up: {take_off: {height_m: 2}}}}", "depart: {}", "'actions' is missing in depart"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_told_with_its_place(old: str, new: str, expected: str) -> None:
    text = own(MISSION)
    assert old in text
    assert any(expected in one for one in found(text.replace(old, new))), found(text.replace(old, new))


def test_a_library_that_is_not_there_or_is_none_is_told_where_it_is_included(
    lanes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    library = lanes.parent / "lanes.yaml"
    library.unlink()
    app(["check", str(lanes)], exit_on_error=False, result_action="return_value")
    assert "m.yaml:3:11: lanes.yaml cannot be read: no such file or directory" in capsys.readouterr().out
    library.write_text("define: {lane: {actions: {}}}\ntasks: {}\n")
    app(["check", str(lanes)], exit_on_error=False, result_action="return_value")
    reported = capsys.readouterr().out
    assert "lanes.yaml:2:1: a library has no key 'tasks'" in reported
    lanes.write_text(MISSION.replace("lanes.yaml", "/etc/passwd"))
    app(["check", str(lanes)], exit_on_error=False, result_action="return_value")
    assert "/etc/passwd is not a relative path" in capsys.readouterr().out


def test_a_text_whose_libraries_are_not_with_it_says_so_and_opens_no_file() -> None:
    assert any("the included libraries are missing" in one for one in found(MISSION))


@pytest.mark.thorough
def test_uses_cannot_make_a_short_file_stand_for_a_huge_one() -> None:
    points = ", ".join("[1, 2, 3]" for _ in range(1000))
    uses = "".join(f"  t{index}: {{use: way}}\n" for index in range(100))
    text = f"""\
mission: m
frame: hold
define: {{way: {{actions: {{fly: {{follow_waypoints: {{waypoints_m: [{points}]}}}}}}}}}}
tasks:
{uses}"""
    assert any("make more than 50,000 values" in one for one in found(text))
