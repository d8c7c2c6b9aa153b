"""`gloc3 mission` checks, draws and converts, with exit codes 0, 1 and 2."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from gloc3.errors import Refused
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.examples import example_missions
from gloc3.mission.reading.reader import load_mission
from gloc3.mission.showing.cli import app
from gloc3.mission.showing.show import WIDTH, drawing, mermaid
from gloc3.platform.platform import Platform

MISSION = """\
mission: two branches
frame: hold
on_failure: land
tasks:
  depart: {actions: {climb: {take_off: {height_m: 1.5}}}}
  sweep:
    after: [depart]
    deadline_s: 120
    actions:
      wall: {follow_waypoints: {waypoints_m: [[2, 1, 2], [16, 1, 2]], heading: {look_at: [1, 2, 3]}}}
      photos: {record_images: {camera: ground, every_m: 0.5}, until: wall, on_failure: continue}
  rest:
    after: [depart]
    actions: {rest: {wait: {duration_s: 5}}}
  recover: {after: [sweep, rest], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""

DRAWING = """\
two branches   (frame hold)
about 35 s, 36 m, 1.8 of 53.2 Wh
on failure land, link loss hold, low battery return, pose lost land

                                                          0                 35 s
● depart
│ ○ climb  take_off height 1.5 m  (claims motion)         ━━━
├─● sweep  (after depart; deadline 120 s)
│   ├─○ wall  follow_waypoints 2 waypoints heading look_…   ━━━━━━━━━━━━
│   │      (claims motion)
│   ╰─○ photos  record_images ground every 0.5 m            ━━━━━━━━━━━━
│          (until wall; on failure continue; claims camera)
├─● rest  (after depart)
│   ○ rest  wait duration 5 s                               ━━━━
● recover  (after sweep, rest)
  ○ home  return_home  (claims motion)                                 ━━━━━
  ○ down  land  (after home; claims motion)                                ━━━━━
"""

FLOWCHART = """\
flowchart LR
    subgraph t_depart[depart]
        t_depart__climb["climb<br/>take_off height 1.5 m"]
    end
    subgraph t_sweep["sweep<br/>deadline 120 s"]
        t_sweep__wall["wall<br/>follow_waypoints 2 waypoints heading look_at"]
        t_sweep__photos["photos<br/>record_images ground every 0.5 m"]
        t_sweep__photos -. until .-> t_sweep__wall
    end
    subgraph t_rest[rest]
        t_rest__rest["rest<br/>wait duration 5 s"]
    end
    subgraph t_recover[recover]
        t_recover__home["home<br/>return_home"]
        t_recover__down["down<br/>land"]
        t_recover__home --> t_recover__down
    end
    t_depart --> t_sweep
    t_depart --> t_rest
    t_sweep --> t_recover
    t_rest --> t_recover
"""


def run(*arguments: str | Path) -> int:
    result = app([str(one) for one in arguments], exit_on_error=False, result_action="return_value")
    assert isinstance(result, int)
    return result


@pytest.fixture
def platform_file(tmp_path: Path, platform_text: str) -> Path:
    path = tmp_path / "pelican.yaml"
    path.write_text(platform_text)
    return path


def test_a_mission_is_drawn_with_its_branches_bars_and_claims(pelican: Platform) -> None:
    circumstances = Circumstances(platform=pelican)
    report = check_text(MISSION, "m", circumstances)
    assert drawing(report, circumstances.capabilities(), pelican) == DRAWING
    assert mermaid(report.flyable()) == FLOWCHART


@pytest.mark.parametrize("name", sorted(example_missions()))
def test_drawings_fit_a_terminal(name: str, platform_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run(
            "show",
            name,
            "--platform",
            {"survey": "boat", "mapping": "plane", "powerline": "vtol"}.get(name, platform_file),
        )
        == 0
    )
    assert max(len(line) for line in capsys.readouterr().out.splitlines()) <= WIDTH


ANYWHERE = """\
mission: two sides
frame: hold
on_failure: land
tasks:
  up: {platform: each, actions: {go: {take_off: {height_m: 2}}}}
  left: {platform: any, after: [up], actions: {go: {go_to: {position_m: [5, 9, 2]}}}}
  right: {platform: any, after: [up], actions: {go: {go_to: {position_m: [5, -9, 2]}}}}
  down: {platform: each, after: [left, right], actions: {end: {land: {}}}}
"""


def test_check_and_show_say_who_does_what(
    tmp_path: Path, platform_file: Path, platform_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path, heron = tmp_path / "sides.yaml", tmp_path / "heron.yaml"
    path.write_text(ANYWHERE)
    heron.write_text(platform_text.replace("platform: pelican", "platform: heron"))
    both = ("--platform", platform_file, "--platform", heron)
    assert run("check", path, *both) == 0
    out = capsys.readouterr().out.splitlines()
    assert [line.partition(" (about")[0] for line in out] == [
        "pelican: left",
        "heron: right",
        f"{path} is fit to fly: about 23 s, 29 m, 2.3 Wh",
    ]
    assert run("check", path, "--json", *both) == 0
    assert json.loads(capsys.readouterr().out)["assigned"]["heron"]["tasks"] == ["right"]
    assert run("show", path, *both) == 0
    assert "├─● left  (after up; on pelican)" in capsys.readouterr().out
    assert run("check", path) == 0
    assert "--platform A --platform B assigns left, right" in capsys.readouterr().out
    with pytest.raises(Refused, match="two platform files are named heron"):
        run("check", path, "--platform", heron, "--platform", heron)


def test_check_says_what_is_wrong_where_and_fails(
    tmp_path: Path, platform_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(MISSION.replace("camera: ground", "camera: front"))
    assert run("check", path, "--platform", platform_file) == 1
    out = capsys.readouterr().out.splitlines()
    assert out[0] == f"{path}:11:40: camera 'front' is not possible on pelican (known: ground)"
    assert out[-1] == f"{path} is not fit to fly: 1 error"
    path.write_text(MISSION)
    assert run("check", path, "--platform", platform_file) == 0
    assert "is fit to fly: about 35 s, 36 m, 1.8 Wh" in capsys.readouterr().out
    assert run("check", path, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["is_ok"] is True
    assert report["findings"][0]["is_warning"] is True
    path.write_text("a: [")
    assert run("check", path, "--json") == 1
    assert json.loads(capsys.readouterr().out)["findings"][0]["line"] == 2
    assert run("show", path) == 1


def test_what_is_asked_of_a_platform_that_nobody_knows_is_not_called_fit_to_fly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "up.yaml"
    path.write_text(
        "mission: up\nframe: hold\ntasks:\n"
        "  up: {platform: hummingbrd, actions: {up: {take_off: {height_m: 2}}, down: {land: {}, after: [up]}}}\n"
    )
    assert run("check", path) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[-1] == f"{path} is well written; what hummingbrd needs was not checked (2 warnings)"
    assert "(did you mean 'hummingbird'?)" in out[-2]


@pytest.mark.parametrize("command", ["check", "show"])
def test_what_is_not_there_is_wrong_use(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(command, "inspektion") == 2
    assert "no such mission (did you mean 'inspection'?)" in capsys.readouterr().err
    assert run(command, "hop", "--platform", tmp_path / "none.yaml") == 2
    assert "cannot be read: no such file or directory" in capsys.readouterr().err
    assert run("convert", "hop", tmp_path / "hop.doc") == 2
    assert run("convert", "hop", tmp_path / "none" / "hop.yaml") == 2


def test_conversions_go_by_suffix(tmp_path: Path, platform_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "geo.yaml"
    source.write_text(
        "mission: geo\nframe: geo\ngeofence: {polygon: [[46, 7], [48, 7], [48, 9], [46, 9]], ceiling_m: 100}\ntasks:\n  t:\n    actions:\n"
        "      up: {take_off: {height_m: 5}}\n"
        "      go: {go_to: {position: [47, 8, 10], speed_m_s: 9}, after: [up]}\n"
        "      home: {return_home: {}, after: [go]}\n      down: {land: {}, after: [home]}\n"
    )
    assert run("convert", source, tmp_path / "geo.plan") == 0
    assert "a plan cannot hold the fence's ceiling" in capsys.readouterr().err
    assert run("convert", tmp_path / "geo.plan", tmp_path / "geo.waypoints") == 0
    assert "a waypoint file cannot hold the fence and rally points" in capsys.readouterr().err
    assert run("convert", tmp_path / "geo.waypoints", tmp_path / "again.yaml", "--platform", platform_file) == 0
    assert "9 m/s is reduced to the platform's 3 m/s" in capsys.readouterr().err
    assert run("check", tmp_path / "again.yaml", "--platform", platform_file) == 0
    assert run("check", tmp_path / "geo.plan") == 0
    assert run("convert", source, tmp_path / "copy.yaml") == 0
    assert run("convert", "hop", tmp_path / "hop.plan") == 1
    assert "frame hold has no place on Earth in a plan" in capsys.readouterr().err


def test_a_picture_shows_the_way_the_fence_and_every_action_with_its_time(pelican: Platform, tmp_path: Path) -> None:
    file = tmp_path / "m.svg"
    assert app(["show", "patrol", "--svg", str(file)], exit_on_error=False, result_action="return_value") == 0
    root = ET.fromstring(file.read_text(encoding="utf-8"))
    mission = load_mission("patrol")
    texts = {text[0].tail if len(text) else text.text for text in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {name.partition(".")[2] for name in mission.actions()} | set(mission.tasks) <= texts
    routes = list(root.iter("{http://www.w3.org/2000/svg}polyline"))
    assert len(routes) == sum(action.order.moves for action in mission.actions().values())


def test_a_mission_is_simulated_by_the_command_that_the_simulation_brings() -> None:
    assert "simulate" in list(app)


def test_fences_and_rally_points_alone_are_checked_and_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fence = tmp_path / "fence.txt"
    fence.write_text("47.001 8.001\n47.0 8.0\n47.002 8.0\n47.002 8.002\n47.0 8.002\n47.0 8.0\n")
    assert app(["check", str(fence)], result_action="return_value") == 0
    assert capsys.readouterr().out == f"{fence} can be uploaded: 1 fence area; it holds no mission\n"
    assert app(["show", str(fence)], result_action="return_value") == 0
    shown = capsys.readouterr().out
    assert shown.startswith("fence       inside of 4 corners: 47.0000000, 8.0000000; ")
    assert "return to   47.0010000, 8.0010000" in shown
    fence.write_text("47.01 8.001\n47.0 8.0\n47.002 8.002\n47.002 8.0\n47.0 8.002\n")
    assert app(["check", str(fence)], result_action="return_value") == 1
    told = capsys.readouterr().out
    assert "area 1 of the fence: the polygon crosses itself" in told
    assert "the return point is 889.4 m outside the fence (move it inwards)" in told


def test_a_plan_that_cannot_become_a_mission_is_listed_by_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "loops.waypoints"
    plan.write_text(
        "QGC WPL 110\n0 1 0 16 0 0 0 0 47.0 8.0 488 1\n1 0 3 22 0 0 0 0 0 0 10 1\n"
        "2 0 3 16 3 0 0 0 47.001 8.0 10 0\n3 0 0 177 1 2 0 0 0 0 0 1\n"
    )
    assert app(["show", str(plan)], result_action="return_value") == 0
    assert capsys.readouterr().out == (
        "home        47.0000000, 8.0000000  488 m above sea\n"
        "item 1      NAV_TAKEOFF               here  10 m above home  (line 3)\n"
        "item 2      NAV_WAYPOINT              47.0010000, 8.0000000  10 m above home  param1 3  waits there  (line 4)\n"
        "item 3      DO_JUMP                   param1 1  param2 2  (line 5)\n"
    )
    assert app(["check", str(plan)], result_action="return_value") == 1
    assert f"{plan}:5:1: item 3, DO_JUMP: cannot be expressed in a mission" in capsys.readouterr().out
