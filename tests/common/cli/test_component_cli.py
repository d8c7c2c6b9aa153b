"""`gloc3 component`: what it says of components, to people and to programs."""

import json
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from tests.common.component.specimen import Driver, Specimen, topics

from gloc3.cli.component import app
from gloc3.component import description as component_description
from gloc3.component.deployment import COMPONENTS
from gloc3.component.description import bounds_of, describe, find_class, spell
from gloc3.component.lci import State
from gloc3.component.settings import Bounds
from gloc3.errors import Gloc3Error
from gloc3.messages.topics import TopicTable

HERE = f"{Specimen.__module__}:Specimen"

PLATFORM = f"""
platform: bench
vehicle: {{type: rov, mass_kg: 3}}
components:
  - {{name: doubler, class: "{HERE}", rate_hz: 10, trigger: given, ports: {{result: doubled}}, settings: {{offset: 2}}, devices: {{diary: diary}}}}
  - {{name: spare, class: "{HERE}", rate_hz: 10, ports: {{result: doubled}}, begin: quiet, standby_for: doubler, devices: {{diary: diary}}}}
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What the command prints."""
    assert app(list(arguments), exit_on_error=False, result_action="return_value") == 0
    return capsys.readouterr().out


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two packages that bring components, one of them broken."""
    points = [
        EntryPoint("specimen", HERE, COMPONENTS),
        EntryPoint("broken", "nowhere:Thing", COMPONENTS),
    ]
    monkeypatch.setattr(component_description, "installed_points", lambda group: points)


@pytest.fixture
def platform(tmp_path: Path) -> str:
    """A platform file."""
    file = tmp_path / "bench.yaml"
    file.write_text(PLATFORM, encoding="utf-8")
    return str(file)


def test_a_class_says_what_it_takes_gives_and_can_be_set_to() -> None:
    found = describe(Specimen, topics())
    assert (found.class_path, found.kind, found.devices) == (HERE, "DP", ("diary",))
    assert found.doc == "Gives what comes in, times a factor, plus an offset."
    assert [(p.name, p.message, p.topics, p.rate_hz, p.queue) for p in found.inputs] == [
        ("given", "Number", ("given",), 10.0, "latest, 1"),
        ("every", "Number", ("every",), None, "all, 4"),
    ]
    (offset,) = found.settings
    assert (offset.type, offset.bounds, offset.default) == ("float", ">= -100, <= 100", 0.0)
    assert offset.doc == "Added to what comes in, in whatever it is in."
    functions = {function.name: function for function in found.functions}
    assert list(functions) == ["scale", "set_rate", "set_logging"]
    assert functions["scale"].arguments[0].bounds == ">= -10, <= 10"
    assert [result.name for result in functions["scale"].results] == ["before"]
    assert "table" in found.loggable


@pytest.mark.parametrize(
    ("annotation", "text", "bounds"),
    [
        (float, "float", ""),
        (Annotated[float, Bounds(0.0, 2.5)], "float", ">= 0, <= 2.5"),
        (tuple[float, ...] | None, "tuple[float, ...] | None", ""),
        (list[Annotated[int, Bounds(1, 9)]], "list[int]", ">= 1, <= 9"),
        (dict[str, Any], "dict[str, Any]", ""),
        (Literal["a", "b"], "'a' | 'b'", ""),
        (State, "idle | standby | working | quiet | faulty", ""),
    ],
)
def test_types_are_spelled_as_an_integrator_writes_them(annotation: Any, text: str, bounds: str) -> None:
    assert (spell(annotation), bounds_of(annotation)) == (text, bounds)


def test_a_description_for_people_has_every_part(capsys: pytest.CaptureFixture[str]) -> None:
    text = run(capsys, "describe", HERE)
    for part in ("DP, data processor", "given", "Number", "offset", ">= -100, <= 100", "scale", "Sets the factor."):
        assert part in text
    assert "loggable: factor, cycles, broken, table" in text
    assert max(len(line) for line in text.splitlines()) <= 120


def test_a_description_for_programs_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(run(capsys, "describe", HERE, "--json"))
    assert found["kind"] == "DP"
    assert found["settings"][0]["default"] == 0.0
    assert found["row"] is None


def test_on_a_platform_a_component_is_described_as_it_is_deployed(
    capsys: pytest.CaptureFixture[str], platform: str
) -> None:
    text = run(capsys, "describe", "doubler", "--platform", platform)
    assert "here: doubler, 10 Hz, triggered by given, begins working" in text
    assert "doubled" in text
    found = json.loads(run(capsys, "describe", "spare", "--platform", platform, "--json"))
    assert found["outputs"][0]["topics"] == ["doubled"]
    assert found["row"]["standby_for"] == "doubler"


def test_the_components_of_a_platform_are_listed(capsys: pytest.CaptureFixture[str], platform: str) -> None:
    text = run(capsys, "list", "--platform", platform)
    assert "doubler" in text
    assert "Specimen" in text
    rows = json.loads(run(capsys, "list", "--platform", platform, "--json"))
    assert [(row["name"], row["begin"]) for row in rows] == [("doubler", "working"), ("spare", "quiet")]


@pytest.mark.usefixtures("installed")
def test_installed_components_are_listed_and_go_by_their_names(capsys: pytest.CaptureFixture[str]) -> None:
    text = run(capsys, "list")
    assert "Gives what comes in" in text
    assert "cannot load 'nowhere:Thing'" in text
    assert "data processor" in run(capsys, "describe", "specimen")


def test_without_installed_components_it_says_how_they_come(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(component_description, "installed_points", lambda group: [])
    assert "gloc3.components entry points" in run(capsys, "list")
    assert json.loads(run(capsys, "list", "--json")) == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("specmen", "no installed component is called 'specmen' (did you mean 'specimen'?)"),
        ("nowhere:Thing", "cannot load 'nowhere:Thing'"),
        ("gloc3.component.lci:State", "'gloc3.component.lci:State' is not a component class"),
        ("gloc3.component.lci:Nothing", "cannot load 'gloc3.component.lci:Nothing'"),
    ],
)
@pytest.mark.usefixtures("installed")
def test_a_name_that_is_no_component_is_an_error_with_the_nearest(name: str, message: str) -> None:
    with pytest.raises(Gloc3Error) as error:
        find_class(name)
    assert message in str(error.value)


def test_a_component_that_a_platform_does_not_have_is_an_error_with_the_nearest(platform: str) -> None:
    with pytest.raises(Gloc3Error, match=r"no component 'dubler' \(did you mean 'doubler'\?\)"):
        app(["describe", "dubler", "--platform", platform], exit_on_error=False, result_action="return_value")


def test_a_driver_is_described_as_one() -> None:
    assert describe(Driver, TopicTable()).kind == "AD"
