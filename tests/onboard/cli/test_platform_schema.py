"""The JSON Schema of platform files says what the check says, down to the settings of each component's class."""

import json
from pathlib import Path
from random import Random

import pytest
from jsonschema import Draft202012Validator
from tests.common.damage import damaged

from gloc3.documents.document import parse
from gloc3.documents.json_schema import as_text
from gloc3.errors import InputError
from gloc3.platform.bases import platform_files
from gloc3.platform.reader import read_platform, whole_text
from gloc3.platform.schema import platform_schema
from gloc3_onboard.cli.platform import app

pytestmark = pytest.mark.thorough

PUBLISHED = Path(__file__).parents[3] / "docs" / "schema" / "platform.schema.json"
VALIDATOR = Draft202012Validator(platform_schema())
COPTER = whole_text("copter")


def is_read(text: str) -> bool:
    try:
        read_platform(text, "p", is_loading_classes=True)
    except InputError:
        return False
    return True


def test_the_published_schema_is_that_of_the_reader(tmp_path: Path) -> None:
    assert PUBLISHED.read_text(encoding="utf-8") == as_text(platform_schema()), "run: make schema"
    Draft202012Validator.check_schema(platform_schema())
    assert app(["schema", "--out", str(tmp_path / "p.json")], exit_on_error=False, result_action="return_value") == 0
    assert (tmp_path / "p.json").read_text(encoding="utf-8") == PUBLISHED.read_text(encoding="utf-8")


def test_every_installed_platform_fits() -> None:
    for name, file in platform_files().items():
        platform = parse(file.read_text(encoding="utf-8"), name).value
        assert [error.message for error in VALIDATOR.iter_errors(platform)] == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("vehicle: {type: quadrotor", "vehicle: {type: quadcopter"),
        ("arguments: take_off", "arguments: takeoff"),
        ("{arguments: hold, performed_by: hold, claims: [motion]", "{arguments: hold, performed_by: hold, claims: []"),
        ("settings: {arm: true}", "settings: {arms: true}"),
        ("settings: {arm: true}", "settings: {arm: 3}"),
        ("rate_hz: 20", "rate_hz: 20000"),
        ("devices: {device: autopilot}", "devices: {devise: autopilot}"),
        ("trigger: pose", "trigger: post"),
        ("manoeuvre_wanted: manoeuvre_wanted/landing", "manoeuvre_wnated: manoeuvre_wanted/landing"),
    ],
)
def test_mistakes_are_marked_that_the_check_finds(old: str, new: str) -> None:
    assert old in COPTER
    text = COPTER.replace(old, new, 1)
    assert not is_read(text)
    assert not VALIDATOR.is_valid(parse(text, "p").value)


def test_damaged_platforms_are_never_marked_where_the_check_takes_them() -> None:
    platform, refused, missed = parse(COPTER, "p").value, 0, 0
    for seed in range(80):
        made = damaged(platform, Random(seed))
        was_read, is_valid = is_read(json.dumps(made)), VALIDATOR.is_valid(made)
        assert is_valid or not was_read, f"seed {seed}: {[error.message for error in VALIDATOR.iter_errors(made)]}"
        refused += not was_read
        missed += not was_read and is_valid
    assert refused > 60
    assert missed < 0.15 * refused


@pytest.mark.parametrize(
    "part",
    [{"components": [{"name": "hold"}]}, {"limits": None, "frames": {"site": None}}, {"vehicle": {"mass_kg": 2}}],
)
def test_only_a_file_that_extends_another_may_leave_out_what_is_needed(part: dict[str, object]) -> None:
    alone = {"platform": "p", "vehicle": {"type": "boat", "mass_kg": 8}, **part}
    assert VALIDATOR.is_valid({"extends": "copter", "platform": "p", **part})
    assert is_read(json.dumps({"extends": "copter", "platform": "p", **part}))
    if part != {"limits": None, "frames": {"site": None}}:
        assert not VALIDATOR.is_valid(alone)
    assert not is_read(json.dumps(alone))
    assert not VALIDATOR.is_valid({"extends": "coptre", "platform": "p"})


def test_damaged_changes_of_a_base_are_refused_or_read() -> None:
    change = {"extends": "copter", **parse(platform_files()["copter"].read_text(encoding="utf-8"), "c").value}
    was_read = 0
    for seed in range(60):
        made = damaged(change, Random(seed))
        was_read += is_read(json.dumps(made))
        assert VALIDATOR.is_valid(made) or not is_read(json.dumps(made)), f"seed {seed}"
    assert 0 < was_read < 40
