"""Formats of plans from installed packages: the example's GPX routes are converted, opened by the station and written."""

from pathlib import Path

import pytest
from tests.installed_package import install, install_example

from gloc3.errors import InputError
from gloc3.mission.formats import load_plan
from gloc3.mission.formats.items import ForeignPlan, MavItem, PlanEntry
from gloc3.mission.showing.cli import app
from gloc3_groundstation.missions.draft import opened
from gloc3_groundstation.missions.files import listing
from gloc3_groundstation.services.plan_items import PlanParts
from gloc3_groundstation.services.plans import PlanService, VehiclePlan

ROUTE = """<?xml version="1.0"?>
<gpx version="1.1" creator="a map" xmlns="http://www.topografix.com/GPX/1/1">
  <wpt lat="1.0" lon="1.0"/>
  <rte>
    <name>around the field</name>
    <rtept lat="47.3977420" lon="8.5455940"><ele>498.0</ele></rtept>
    <rtept lat="47.3980000" lon="8.5460000"><ele>498.5</ele><name>corner</name></rtept>
    <rtept lat="47.3982000" lon="8.5457000"><ele>499.0</ele></rtept>
  </rte>
  <rte><rtept lat="2.0" lon="2.0"><ele>1.0</ele></rtept></rte>
</gpx>
"""
BROKEN = """
from gloc3.mission.formats.plan_format import PlanFormat

def fail(data, file):
    raise KeyError("no such\\nthing")

BAD = PlanFormat(title="bad file", suffixes=(".bad",), read=fail)
EMPTY = PlanFormat(title="empty file", suffixes=(".empty",), read=lambda data, file: None)
THIEF = PlanFormat(title="thief", suffixes=(".plan",), read=fail)
NOTHING = 7
"""


@pytest.fixture
def route(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A route, with the example installed."""
    packages = tmp_path / "packages"
    packages.mkdir()
    install_example(packages)
    monkeypatch.syspath_prepend(packages)
    file = tmp_path / "field.gpx"
    file.write_text(ROUTE)
    return file


def run(*arguments: object) -> int:
    result = app([str(one) for one in arguments], result_action="return_value", exit_on_error=False)
    assert isinstance(result, int)
    return result


def test_a_route_is_converted_into_the_other_formats_and_back(route: Path, capsys: pytest.CaptureFixture[str]) -> None:
    items = load_plan(route).items
    assert [(item.x, item.y, item.z, item.frame) for item in items] == [
        (47.397742, 8.545594, 498.0, 0),
        (47.398, 8.546, 498.5, 0),
        (47.3982, 8.5457, 499.0, 0),
    ]
    plan, again = route.with_suffix(".plan"), route.with_name("again.gpx")
    assert run("convert", route, plan) == 0
    assert load_plan(plan).items == items
    assert run("convert", plan, again) == 0
    assert load_plan(again).items == items
    mission = route.with_suffix(".yaml")
    assert run("convert", route, mission) == 0
    assert run("check", mission) == 0
    assert "fit to fly" in capsys.readouterr().out
    assert run("convert", route, mission, "--as-it-is") == 1
    assert "convert it to .plan first" in capsys.readouterr().err
    assert run("convert", plan, mission, "--as-it-is") == 0
    assert run("check", mission) == 0
    mission.write_text(mission.read_text().replace("field.plan", "field.gpx"))
    assert run("check", mission) == 1
    assert "convert it to .plan first" in capsys.readouterr().out


def test_what_is_wrong_in_a_route_is_told_with_its_line(route: Path) -> None:
    for bad, line, message in (
        (ROUTE.replace("<ele>498.5</ele>", ""), 7, "point 2 has no elevation"),
        (ROUTE.replace('lat="47.3980000"', 'lat="98"'), 7, "lat '98' is no number from -90 to 90"),
        (ROUTE.replace("</gpx>", ""), 12, "not XML: no element found"),
        ('<?xml version="1.0"?>\n<!DOCTYPE gpx [<!ENTITY a "aaaa">]>\n<gpx/>', 2, "a document type is not read"),
        ("<kml/>", 1, "<kml> is no GPX file"),
        ("<gpx/>", 0, "it has no route (<rte>)"),
    ):
        route.write_text(bad)
        with pytest.raises(InputError) as raised:
            load_plan(route)
        assert (raised.value.findings[0].line, raised.value.findings[0].message) == (line, message)


def test_the_station_lists_opens_and_writes_routes(route: Path) -> None:
    assert ("field.gpx", "GPX route") in [(one.name, one.kind) for one in listing(route.parent).entries]
    draft = opened(str(route), None)
    assert draft.made_of == str(route)
    assert "47.397742" in draft.text
    assert any("further routes are left out" in one.message for one in draft.left_out)
    plan = PlanService.read(route)
    up = MavItem(command=22, frame=3, x=0.0, y=0.0, z=10.0)
    plan = ForeignPlan(entries=(PlanEntry(items=(up,)), *plan.entries), raw={})
    saved = route.with_name("saved.gpx")
    PlanService.save(VehiclePlan(plan=plan, parts=PlanParts()), saved)
    assert load_plan(saved).items == load_plan(route).items
    relative = ForeignPlan(entries=(PlanEntry(items=(MavItem(command=16, frame=3, x=1.0, y=1.0, z=5.0),)),), raw={})
    with pytest.raises(InputError, match="because the plan has no home"):
        PlanService.save(VehiclePlan(plan=relative, parts=PlanParts()), saved)


def test_formats_that_fail_are_named_and_hurt_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gloc3_bad_formats.py").write_text(BROKEN)
    points = {name: f"gloc3_bad_formats:{name.upper()}" for name in ("bad", "empty", "thief", "nothing", "gone")}
    install(tmp_path, "gloc3_bad_formats", {"gloc3.plan_formats": points})
    monkeypatch.syspath_prepend(tmp_path)
    bad, empty = tmp_path / "a.bad", tmp_path / "a.empty"
    bad.write_text("x")
    empty.write_text("x")
    with pytest.raises(InputError, match=r"the plug-in for a bad file has failed: KeyError"):
        load_plan(bad)
    with pytest.raises(InputError, match="it returned NoneType, not ForeignPlan"):
        load_plan(empty)
    assert run("check", "inspection") == 0
    field = tmp_path / "field.waypoints"
    field.write_text("QGC WPL 110\n0 1 0 16 0 0 0 0 47.4 8.5 480 1\n1 0 3 16 0 0 0 0 47.4 8.5001 10 1\n")
    assert run("convert", field, tmp_path / "out.bad") == 1
    assert "a bad file (.bad) is only read" in capsys.readouterr().err
    assert run("convert", "inspection", tmp_path / "out.xyz") == 2
    told = capsys.readouterr().err
    assert "plug-in thief (gloc3.plan_formats) is left out: the suffix .plan belongs to QGroundControl plan" in told
    assert "plug-in nothing (gloc3.plan_formats) is left out: gloc3_bad_formats:NOTHING is no PlanFormat" in told
    assert "plug-in gone (gloc3.plan_formats) is left out: AttributeError" in told
