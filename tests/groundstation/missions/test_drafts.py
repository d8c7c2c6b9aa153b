"""Missions that are opened, edited, saved and exported at the station, whatever is in the files."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import InputError, Refused
from gloc3.mission.formats import exported
from gloc3.mission.reading.reader import read_mission
from gloc3_groundstation.missions.draft import Draft, checked, edited, new_draft, objection, opened, saved, written_as
from gloc3_groundstation.missions.plans import known_platform

GEO = """mission: round the mast
frame: geo
geofence: {polygon: [[39.5527, 2.6284], [39.5531, 2.6284], [39.5531, 2.6288], [39.5527, 2.6288]], ceiling_m: 50}
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 5}}
      way: {follow_waypoints: {waypoints: [[39.5528, 2.6285, 5], [39.5529, 2.6286, 6]], speed_m_s: 4}, after: [up]}
      down: {land: {}, after: [way]}
"""


def test_an_example_is_checked_for_its_vehicle_and_has_no_file_to_be_saved_in() -> None:
    draft = opened("inspection", known_platform("pelican_rtk"))
    assert (draft.is_ok, draft.platform, draft.path, draft.is_changed) == (True, "pelican", "", False)
    plan = draft.plan()
    assert plan is not None
    assert plan.title == "cargo hold inspection"
    wrong = checked(edited(draft, draft.text.replace("every_m: 0.5", "every_m: none")), known_platform("pelican_rtk"))
    assert wrong.plan() is None
    assert [(finding.line, finding.column) for finding in wrong.findings] == [(22, 57)]
    assert new_draft(known_platform("pelican_rtk")).is_ok


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.yaml", b"\xff\xfe\x00"),
        ("a.yaml", b""),
        ("a.yaml", b"mission: [\n"),
        ("a.plan", b'{"fileType": "Plan", "mission": {'),
        ("a.plan", b"[]"),
        ("a.waypoints", b"QGC WPL 110\n0\t1\t0\n"),
        ("a.txt", b"shopping list"),
        ("a.yaml", b"x" * 2_000_000),
    ],
)
def test_a_bad_file_is_shown_with_what_is_wrong_in_it(tmp_path: Path, name: str, data: bytes) -> None:
    file = tmp_path / name
    file.write_bytes(data)
    draft = opened(str(file), None)
    assert draft.errors
    assert draft.plan() is None
    assert all(finding.file == name for finding in draft.findings)
    assert not draft.is_changed


@settings(max_examples=40)
@given(data=st.binary(max_size=300), suffix=st.sampled_from([".yaml", ".plan", ".waypoints"]))
def test_no_bytes_make_opening_fail(tmp_path_factory: pytest.TempPathFactory, data: bytes, suffix: str) -> None:
    file = tmp_path_factory.getbasetemp() / f"any{suffix}"
    file.write_bytes(data)
    draft = opened(str(file), None)
    assert draft.is_ok or draft.errors


def test_what_is_not_there_or_no_file_is_refused(tmp_path: Path) -> None:
    for name in ("no_such_example", str(tmp_path / "none.yaml"), str(tmp_path)):
        with pytest.raises(Refused):
            opened(name, None)


def test_saving_writes_the_file_whole_and_says_when_another_program_was_there_first(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(GEO)
    draft = edited(opened(str(file), None), GEO.replace("mast", "tower"))
    assert draft.is_changed
    assert objection(draft, file) == ""
    file.write_text(GEO.replace("mast", "bridge"))
    assert objection(draft, file) == "m.yaml was changed by another program since it was opened"
    again = saved(draft, file, None)
    assert not again.is_changed
    assert "tower" in file.read_text()
    assert objection(again, tmp_path / "m.yaml") == ""
    (tmp_path / "other.yaml").write_text("")
    assert objection(again, tmp_path / "other.yaml") == "other.yaml is there already"
    with pytest.raises(Refused, match="cannot be written"):
        saved(draft, tmp_path / "no folder" / "m.yaml", None)


def test_a_plan_becomes_a_mission_and_goes_back_with_what_is_lost_told(tmp_path: Path) -> None:
    plan_text, _ = exported(read_mission(GEO, "m"), ".plan", "m")
    file = tmp_path / "mast.plan"
    file.write_text(plan_text)
    draft = opened(str(file), known_platform("pelican_rtk"))
    assert draft.text.startswith("gloc3: 1\nmission: mast\n")
    assert (draft.path, draft.made_of) == ("", str(file))
    assert [finding.message for finding in draft.left_out] == ["4 m/s is reduced to the platform's 3 m/s"]
    untouched, touched = draft.plan(), checked(edited(draft, draft.text + "# by hand\n"), None).plan()
    assert untouched is not None
    assert touched is not None
    assert (untouched.converted_from, touched.converted_from) == (str(file), "")
    text, lost = written_as(draft, tmp_path / "x.waypoints", None)
    assert text.startswith("QGC WPL 110")
    assert any("fence" in finding.message for finding in lost)
    kept = saved(draft, tmp_path / "x.plan", None)
    assert (kept.path, kept.is_changed) == ("", False)
    assert (tmp_path / "x.plan").read_text().startswith("{")
    with pytest.raises(InputError, match="no place on Earth"):
        written_as(opened("hop", None), tmp_path / "hop.plan", None)


def test_the_first_error_is_found_behind_the_warnings_before_it() -> None:
    text = "mission: x\nframe: hold\ntasks:\n  a:\n    actions:\n      up: {take_off: {hieght_m: 2}}\n"
    text += "      stay: {hold: {duration_s: 5}, after: [up]}\n"
    draft = checked(Draft(name="x.yaml", text=text), known_platform("pelican_rtk"))
    assert draft.requested[0].is_warning
    assert not draft.requested[draft.first_error].is_warning
    assert draft.requested[draft.first_error].line == 6
