"""Missions to begin with: right as they are, for every platform that can do them, and known to editors."""

from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from gloc3.documents.document import parse
from gloc3.errors import Refused
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.reading.mission_schema import mission_schema
from gloc3.mission.showing.cli import app
from gloc3.mission.templates import mission_from, templates
from gloc3.platform.bases import platform_files
from gloc3.platform.reader import load_platform

DIVING = ("auv", "rov", "submarine")
WINGED = ("plane", "vtol")


@pytest.mark.parametrize("name", sorted(platform_files()))
@pytest.mark.thorough
def test_every_template_is_right_as_it_is_for_every_platform_that_can_do_it(name: str) -> None:
    platform = load_platform(name)
    home = Circumstances(platform=platform, home_ned_m=(0.0, 0.0, 0.0))
    validator = Draft202012Validator(mission_schema(platform))
    for template in templates():
        if template == "dive" and name not in DIVING:
            with pytest.raises(Refused, match=f"{platform.platform} does not dive"):
                mission_from(template, platform, "x.json")
            continue
        if (template == "mapping") is not (name in WINGED):
            with pytest.raises(Refused, match=f"{platform.platform} (needs more room to turn|turns on the spot)"):
                mission_from(template, platform, "x.json")
            continue
        if (template, name) == ("inspection", "boat"):
            with pytest.raises(Refused, match="steers by its heading: it cannot face a wall"):
                mission_from(template, platform, "x.json")
            continue
        text = mission_from(template, platform, "x.json")
        assert [str(finding) for finding in check_text(text, template, home).findings] == []
        assert validator.is_valid(parse(text, template).value)


def test_a_path_beside_which_the_vehicle_has_to_point_elsewhere_is_no_mission_of_one_that_steers_by_its_heading() -> (
    None
):
    boat = Circumstances(platform=load_platform("boat"), home_ned_m=(0.0, 0.0, 0.0))
    text = mission_from("inspection", load_platform("copter"), "x.json")
    found = [str(finding) for finding in check_text(text, "wall.yaml", boat).findings]
    message = (
        "boat steers by its heading and cannot point elsewhere than along its path (go along it with follow_waypoints)"
    )
    assert any(message in one for one in found)


def test_the_command_writes_the_mission_and_its_schema_and_leaves_alone_what_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    command = ["new", "survey", "--platform", "boat", "--file", str(file)]
    assert app(command, exit_on_error=False, result_action="return_value") == 0
    assert file.read_text(encoding="utf-8").startswith("# yaml-language-server: $schema=boat.mission.schema.json\n")
    assert (tmp_path / "boat.mission.schema.json").is_file()
    assert f"gloc3 mission check {file} --platform boat" in capsys.readouterr().out
    file.write_text("mine", encoding="utf-8")
    assert app(command, exit_on_error=False, result_action="return_value") == 2
    assert file.read_text(encoding="utf-8") == "mine"


def test_without_a_name_it_lists_them_and_a_wrong_one_comes_with_the_nearest(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert app(["new"], exit_on_error=False, result_action="return_value") == 0
    assert {line.split()[0] for line in capsys.readouterr().out.splitlines() if line} >= set(templates())
    with pytest.raises(Refused, match=r"there is no template 'surve' \(did you mean 'survey'\?\)"):
        app(["new", "surve"], exit_on_error=False, result_action="return_value")
