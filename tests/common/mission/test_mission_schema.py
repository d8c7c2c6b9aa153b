"""The JSON Schema of missions says what the reader says: nothing that may fly is marked, and what is misspelt is."""

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from tests.common.damage import damaged

from gloc3.documents.document import parse
from gloc3.documents.json_schema import as_text
from gloc3.errors import InputError
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.examples import example_missions
from gloc3.mission.model.structure import structure_findings
from gloc3.mission.reading.mission_schema import mission_schema
from gloc3.mission.reading.reader import MissionReferences, inspect_mission
from gloc3.mission.showing.cli import app
from gloc3.platform.platform import Platform

pytestmark = pytest.mark.thorough

PUBLISHED = Path(__file__).parents[3] / "docs" / "schema" / "mission.schema.json"
VALIDATOR = Draft202012Validator(mission_schema())

EVERYTHING = """\
mission: everything
frame: hold
geofence:
  polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]]
  ceiling_m: 8
  keep_out: [{circle_m: {center_m: [5, 5], radius_m: 1}}]
define:
  leg:
    parameters: {to: {kind: point}, speed: {kind: number, default: 0.5, unit: m/s}}
    deadline_s: 60
    actions:
      go: {go_to: {position_m: $to, speed_m_s: $speed, heading: {look_at: [1, 2, 3]}}}
      stay: {hold: {duration_s: 3}, after: [go]}
tasks:
  up: {actions: {climb: {take_off: {height_m: 1.5}}}}
  one: {use: leg, with: {to: [1, 2, 3]}, after: [up]}
  two:
    after: [one]
    deadline_s: 100
    actions:
      way: {follow_waypoints: {waypoints_m: [[2, 1, 2], [12, 1, 2]], speed_m_s: 0.5}, retries: 2, on_failure: skip}
      photos: {record_images: {camera: ground, every_m: 0.5}, until: way}
      rest: {wait: {duration_s: 3}, after: [way]}
      back: {return_home: {}, after: [rest]}
      down: {land: , after: [back]}
"""


def read_errors(text: str) -> list[str]:
    """What keeps a mission from flying, by the reader alone."""
    try:
        reading = inspect_mission(text, "m", MissionReferences())
    except InputError as error:
        return [str(finding) for finding in error.findings]
    found = [*reading.findings, *structure_findings(reading.tasks)]
    return [finding.message for finding in found if not finding.is_warning]


def missions() -> list[Any]:
    texts = [path.read_text(encoding="utf-8") for path in example_missions().values()]
    return [parse(text, "m").value for text in (*texts, EVERYTHING)]


def test_the_published_schema_is_that_of_the_reader() -> None:
    assert PUBLISHED.read_text(encoding="utf-8") == as_text(mission_schema()), "run: make schema"
    Draft202012Validator.check_schema(mission_schema())


def test_every_example_and_every_feature_fits() -> None:
    for mission in missions():
        assert [error.message for error in VALIDATOR.iter_errors(mission)] == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mission: everything", "misson: everything"),
        ("take_off: {height_m: 1.5}", "takeoff: {height_m: 1.5}"),
        ("height_m: 1.5", "height_m: high"),
        ("height_m: 1.5", "height_m: -1"),
        ("height_m: 1.5", ""),
        ("after: [one]", "after: one"),
        ("every_m: 0.5", "every_m: 0.5, every_s: 1"),
        ("on_failure: skip", "on_failure: give_up"),
        ("wait: {duration_s: 3}", "wait: {duration_s: 3}, hold: {}"),
        ("[2, 1, 2], [12", "[2, 1], [12"),
        ("kind: point}", "kind: place}"),
        ("position_m: $to", "position_m: to"),
        ("use: leg, ", ""),
    ],
)  # fmt: skip
def test_mistakes_are_marked_that_the_reader_finds(old: str, new: str) -> None:
    assert old in EVERYTHING
    text = EVERYTHING.replace(old, new)
    assert read_errors(text)
    assert not VALIDATOR.is_valid(parse(text, "m").value)


def test_damaged_missions_are_never_marked_where_the_reader_takes_them_and_nearly_always_where_it_does_not() -> None:
    whole, refused, missed = missions(), 0, 0
    for seed in range(400):
        random = Random(seed)
        mission = damaged(random.choice(whole), random)
        is_read, is_valid = not read_errors(json.dumps(mission)), VALIDATOR.is_valid(mission)
        assert is_valid or not is_read, f"seed {seed}: {[error.message for error in VALIDATOR.iter_errors(mission)]}"
        refused += not is_read
        missed += not is_read and is_valid
    assert refused > 300
    assert missed < 0.08 * refused, "only names that refer to nothing, and shapes of areas, are left to the reader"


def test_for_a_platform_it_knows_its_capabilities_cameras_and_frames(pelican: Platform) -> None:
    validator = Draft202012Validator(mission_schema(pelican))
    mission = parse(EVERYTHING, "m").value
    assert validator.is_valid(mission)
    assert check_text(EVERYTHING, "m", Circumstances(platform=pelican)).mission is not None
    for previous, new in (("camera: ground", "camera: front"), ("take_off: {height_m: 1.5}", "dive: {depth_m: 1.5}")):
        text = EVERYTHING.replace(previous, new)
        assert not check_text(text, "m", Circumstances(platform=pelican)).is_ok
        assert not validator.is_valid(parse(text, "m").value)
    frame = mission_schema(pelican)["$defs"]["MissionFile"]["properties"]["frame"]
    assert frame["anyOf"][0] == {"enum": ["hold", "geo"]}


def test_what_the_tasks_of_other_platforms_do_is_theirs(pelican: Platform) -> None:
    text = """\
mission: both
frame: hold
tasks:
  mine: {platform: pelican, actions: {climb: {take_off: {height_m: 1}}}}
  theirs: {platform: reef, actions: {down: {dive: {depth_m: 3}}}}
"""
    validator = Draft202012Validator(mission_schema(pelican))
    assert validator.is_valid(parse(text, "m").value)
    assert not validator.is_valid(parse(text.replace("platform: reef", "platform: pelican"), "m").value)


def test_arguments_are_explained_with_their_units() -> None:
    argument = mission_schema()["$defs"]["capability take_off"]["properties"]["height_m"]
    assert argument["description"] == "Height above the vehicle's position on the ground. [m]"
    assert (argument["exclusiveMinimum"], argument["maximum"]) == (0.0, 1000.0)


def test_the_command_writes_the_file(tmp_path: Path) -> None:
    file = tmp_path / "mission.schema.json"
    assert app(["schema", "--out", str(file)], exit_on_error=False, result_action="return_value") == 0
    assert file.read_text(encoding="utf-8") == PUBLISHED.read_text(encoding="utf-8")
