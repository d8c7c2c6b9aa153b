"""Follows `docs/add-a-capability.md` to the letter: installs its package, checks its mission, and flies it."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import platform as heron
from tests.package_of_page import install

from gloc3.documents.document import parse
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.arguments import argument_kinds
from gloc3.mission.reading.mission_schema import mission_schema
from gloc3.mission.showing.capability_lines import capability_line
from gloc3.platform.platform import Platform
from gloc3.platform.reader import read_platform
from gloc3_groundstation.missions.forms import form_for

PAGE = (Path(__file__).parents[2] / "docs" / "add-a-capability.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`([\w./-]+)`:\n\n```\w+\n(.*?)```", PAGE, re.MULTILINE | re.DOTALL))
CAPABILITY, COMPONENT, MISSION = re.findall(r"^```yaml\n(.*?)```", PAGE, re.MULTILINE | re.DOTALL)


def platform_text() -> str:
    """The Pelican's file with the page's two rows, under another name, and nothing else changed."""
    rows = {"capabilities": CAPABILITY, "components": COMPONENT}
    return heron({f"\n{key}:\n": f"\n{key}:\n{row}" for key, row in rows.items()})


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The integrator's package, written from the page and installed as pip would install it."""
    for name, text in FILES.items():
        file = tmp_path / "site" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    install(FILES["pyproject.toml"], tmp_path / "site")
    monkeypatch.syspath_prepend(tmp_path / "site")
    argument_kinds.cache_clear()
    yield
    argument_kinds.cache_clear()
    for name in [name for name in sys.modules if name.partition(".")[0] == "tarn"]:
        del sys.modules[name]


def the_platform() -> Platform:
    return read_platform(platform_text(), "tarn.yaml", is_loading_classes=True)


def test_it_is_explained_checked_estimated_offered_and_known_to_editors(package: None) -> None:
    platform = the_platform()
    line = capability_line("take_water", platform)
    assert (line.package, line.performed_by, line.claims, line.power_w) == ("tarn", "water_sampler", ("sampler",), 36.0)
    report = check_text(MISSION, "m", Circumstances(platform=platform))
    assert report.findings == ()
    assert report.estimate is not None
    figures = report.estimate.actions["samples.second"]
    assert figures.end_s - figures.start_s == pytest.approx(5.0)
    assert figures.energy_wh == pytest.approx(36.0 * 5.0 / 3600.0)
    (error,) = check_text(
        MISSION.replace("after: [first]", "after: [out]"), "m", Circumstances(platform=platform)
    ).findings
    assert "both claim sampler" in error.message
    (error,) = check_text(MISSION.replace("bottle: 1", "bottle: 13"), "m", Circumstances(platform=platform)).findings
    assert str(error) == "m:10:37: bottle: expected a whole number <= 12 (13)"
    form = form_for("take_water", platform.capabilities["take_water"], is_geo=False)
    assert [(field.label, field.unit, field.hint, field.is_required) for field in form.fields] == [
        ("bottle", "", "≥ 1, ≤ 12", True),
        ("duration", "s", "≥ 1, ≤ 120", False),
    ]
    validator = Draft202012Validator(mission_schema(platform))
    assert validator.is_valid(parse(MISSION, "m").value)
    assert not validator.is_valid(parse(MISSION.replace("bottle: 1", "bottel: 1"), "m").value)


@ONE_STYLE
def test_it_is_flown_and_its_message_reaches_the_log_and_the_station(package: None, flight: Card) -> None:
    flight.begin(MISSION, platform=platform_text())
    flight.await_state("samples.first", "running", 60.0)
    flight.wait(1.0)
    flight.command("pause", "samples.first")
    flight.wait(10.0)
    flight.command("resume", "samples.first")
    flight.await_state("mission", "done", 60.0)
    used = [envelope.payload for envelope in flight.received["water_taken"]]
    assert [one.bottle for one in used] == [1, 2]
    assert all(one.duration_s == pytest.approx(5.0, abs=0.2) for one in used), "pauses are not counted"
