"""Files say which version of their format they have, and newer ones are refused where they say it."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from gloc3.documents.format_version import VERSION, schema_id
from gloc3.errors import InputError
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.examples import example_missions
from gloc3.mission.formats import exported, mission_text
from gloc3.mission.reading.mission_schema import mission_schema
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.mission.templates import mission_from
from gloc3.platform.reader import load_platform, read_platform, whole_text
from gloc3.platform.schema import platform_schema
from gloc3_groundstation.missions.draft import new_draft
from gloc3_groundstation.reporting.schema import lines_schema

PLANS = Path(__file__).parents[2] / "data" / "missions"
MISSION = "mission: up\nframe: hold\ntasks:\n  up: {actions: {climb: {take_off: {height_m: 1.5}}}}\n"
NEWER = (
    f"the file has format {VERSION + 1}; this version of GLOC3 reads formats up to {VERSION}",
    "update GLOC3, or use a file of an earlier format",
)


def only_finding(error: InputError) -> tuple[str, int, int, str, str]:
    (found,) = [one for one in error.findings if not one.is_warning]
    return found.file, found.line, found.column, found.message, found.hint


def test_a_mission_without_a_version_is_of_the_first() -> None:
    assert read_mission(MISSION, "m.yaml").name == "up"
    assert read_mission(f"gloc3: {VERSION}\n{MISSION}", "m.yaml").name == "up"


def test_a_newer_mission_is_refused_where_it_says_so_and_its_other_keys_are_not() -> None:
    with pytest.raises(InputError) as caught:
        read_mission(f"gloc3: {VERSION + 1}\nswarm: 3\n{MISSION}", "m.yaml")
    assert only_finding(caught.value) == ("m.yaml", 1, 8, *NEWER)


def test_a_newer_library_is_refused_in_its_own_file() -> None:
    library = json.dumps(f"gloc3: {VERSION + 1}\nmacros: []\n")
    with pytest.raises(InputError) as caught:
        read_mission(f"include: {{survey.yaml: {library}}}\n{MISSION}", "m.yaml")
    assert only_finding(caught.value) == ("survey.yaml", 1, 8, *NEWER)


def test_a_newer_platform_is_refused_and_so_is_one_that_extends_it(tmp_path: Path) -> None:
    text = f"gloc3: {VERSION + 1}\nwings: 2\n" + whole_text("copter")
    with pytest.raises(InputError) as caught:
        read_platform(text, "p.yaml")
    assert only_finding(caught.value) == ("p.yaml", 1, 8, *NEWER)
    base, own = tmp_path / "base.yaml", tmp_path / "own.yaml"
    base.write_text(text, encoding="utf-8")
    own.write_text("extends: base.yaml\nplatform: heron\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_platform(str(own))
    assert only_finding(caught.value) == (str(base), 1, 8, *NEWER)


@pytest.mark.parametrize("version", ["0", "1.5", "one", "true", "[1]"])
def test_what_is_no_version_is_an_error(version: str) -> None:
    found = check_text(f"gloc3: {version}\n{MISSION}", "m.yaml", Circumstances()).findings
    assert [(one.line, one.column) for one in found if "gloc3" in one.message] == [(1, 8)], found


def test_missions_that_are_written_say_their_version() -> None:
    platform = load_platform("pelican_rtk")
    hop = read_mission(example_missions()["hop"].read_bytes(), "hop.yaml", MissionReferences.of(platform))
    texts = [
        mission_from("survey", platform, "x.json").partition("\n")[2],
        exported(hop, ".yaml", "hop.yaml")[0],
        mission_text(str(PLANS / "survey.plan"), platform)[1],
        new_draft(platform).text,
    ]
    for text in texts:
        first = next(line for line in text.splitlines() if not line.startswith("#"))
        assert first == f"gloc3: {VERSION}"


def test_schemas_have_a_name_of_their_own_and_bound_the_version() -> None:
    mission, platform = mission_schema(), platform_schema()
    names = [one["$id"] for one in (mission, platform, lines_schema(), mission_schema(load_platform("auv")))]
    assert names == [
        "urn:gloc3:schema:mission:1",
        "urn:gloc3:schema:platform:1",
        "urn:gloc3:schema:station-lines:1",
        "urn:gloc3:schema:mission:1:auv",
    ]
    assert schema_id("mission") == names[0]
    for schema in (mission, platform):
        validator = Draft202012Validator(schema)
        errors = [one for one in validator.iter_errors({"gloc3": VERSION + 1}) if list(one.path) == ["gloc3"]]
        assert errors, "an editor marks a newer version"
