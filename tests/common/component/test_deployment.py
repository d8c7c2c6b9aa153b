"""Deployments: rows as data, and what must hold between rows, classes and topics."""

import io
from importlib.metadata import EntryPoint
from typing import Any

import msgspec
import pytest

from gloc3.component import deployment
from gloc3.component.component import Controller, DataProcessor
from gloc3.component.deployment import ComponentRow, check_row, problems_of
from gloc3.component.ports import Inbox, Input, Output
from gloc3.errors import Gloc3Error
from gloc3.messages.envelope import Event
from gloc3.messages.topics import TopicRow, TopicTable

from .specimen import Number, Specimen

HERE = __name__


class Source(DataProcessor):  # type: ignore[type-arg]
    """Gives numbers."""

    given = Output(Number)

    def __init__(self, device: object) -> None:
        self.device = device

    def work(self, now_s: float, inbox: Inbox) -> list[Number]:
        return []


class Listener(DataProcessor):  # type: ignore[type-arg]
    """Takes numbers and events."""

    given = Input(Number)
    event = Input(Event)

    def work(self, now_s: float, inbox: Inbox) -> list[Number]:
        return []


class Keyed(DataProcessor):  # type: ignore[type-arg]
    """Gives numbers to whom it wants."""

    given = Output(Number)

    def work(self, now_s: float, inbox: Inbox) -> list[Number]:
        return []


TOPICS = TopicTable(
    {"given": TopicRow(Number, 10.0), "result": TopicRow(Number), "news": TopicRow(Event), "to/*": TopicRow(Number)}
)


def source(name: str = "source", **entries: Any) -> ComponentRow:
    """A good row for a source."""
    known: dict[str, Any] = {"class": f"{HERE}:Source", "rate_hz": 10.0, "devices": {"device": "d"}}
    return msgspec.convert({"name": name, **known, **entries}, ComponentRow)


def listener(name: str = "listener", **entries: Any) -> ComponentRow:
    """A good row for a listener."""
    known: dict[str, Any] = {"trigger": "given", "ports": {"event": "components/source/event"}}
    return msgspec.convert({"name": name, "class": f"{HERE}:Listener", **known, **entries}, ComponentRow)


def found(*rows: ComponentRow) -> list[str]:
    """What is wrong with a deployment."""
    return [str(problem.finding(rows[problem.row].name)) for problem in problems_of(rows, TOPICS)]


def test_a_good_deployment_has_no_findings() -> None:
    standby = source("spare", standby_for="source", begin="quiet")
    assert found(source(on_fault={"standby": "spare"}), standby, listener()) == []


@pytest.mark.parametrize(
    ("rows", "finding"),
    [
        ([source(ports={"gven": "given"})], "ports.gven: Source has no port 'gven' (did you mean 'given'?)"),
        ([source(ports={"given": []})], "ports.given: bound to no topic (leave the line out for 'given' itself)"),
        ([source(trigger="given")], "trigger: Source has no input 'given' (none is known)"),
        ([source(trigger=["given"])], "trigger.0: Source has no input 'given' (none is known)"),
        ([source(log=["level"])], "log.0: Source cannot log 'level' (none is known)"),
        ([source(rate_hz=None)], "component source would never work (give rate_hz, or trigger with the name of"),
        ([source(settings={"level": 1})], "settings: unknown setting 'level' (none is known)"),
        ([source(devices={})], "devices: Source needs a device 'device' (add it under devices: device: NAME)"),
        ([source(devices={"devcie": "d"})], "devices.devcie: Source has no device 'devcie' (did you mean 'device'?)"),
        ([source(), source()], "name: a second component 'source' (names are unique on a platform)"),
        ([source(**{"class": "nowhere:Thing"})], "class: component source: cannot load 'nowhere:Thing'"),
        ([source(**{"class": f"{HERE}:Number"})], "class: component source:"),
        (
            [source(), source("spare", standby_for="sorce", begin="quiet")],
            "standby_for: no other component 'sorce' (did you mean 'source'?)",
        ),
        ([source("a", standby_for="a", begin="quiet")], "standby_for: no other component 'a' (none is known)"),
        (
            [source(), source("spare", standby_for="source")],
            "begin: a standby starts quiet (at most one of a primary and its standbys is not quiet)",
        ),
        (
            [
                source(),
                source("b", standby_for="source", begin="quiet"),
                source("c", standby_for="b", begin="quiet"),
            ],
            "standby_for: 'b' is itself a standby (name the primary: source)",
        ),
        ([source(on_fault={"standby": "spare"})], "on_fault.standby: no other component 'spare' (none is known)"),
        (
            [source(on_fault={"standby": "listener"}), listener()],
            "on_fault.standby: 'listener' is no standby for it (give listener the row entry standby_for: source)",
        ),
        (
            [source(), source("twin")],
            "ports.given: 'given' is an output of source already (bind 'given' to another topic, or say standby_for:",
        ),
        ([source(ports={"given": "givn"})], "ports.given: unknown topic 'givn' (did you mean 'given'?)"),
        ([source(ports={"given": "news"})], "ports.given: 'news' carries Event, and the port Number"),
        (
            [source(), listener(ports={})],
            "warning: ports.event: the input is bound to no known topic (bind 'event' to a topic, or to [] if it is",
        ),
        ([listener(ports={"event": "evnt"})], "ports.event: unknown topic 'evnt'"),
        (
            [source(), listener(ports={"given": "result", "event": "components/source/event"})],
            "warning: ports.given: no component publishes 'result'",
        ),
        (
            [source(), listener(ports={"event": "components/sorce/event"})],
            "warning: ports.event: no component publishes 'components/sorce/event' (did you mean 'components/source/event'",
        ),
    ],
)
def test_what_is_wrong_in_a_deployment_is_found_with_a_hint(rows: list[ComponentRow], finding: str) -> None:
    findings = found(*rows)
    assert any(finding in text for text in findings), findings


def test_findings_have_their_place_in_the_row() -> None:
    rows = [source(), listener(log=["x"])]
    (problem,) = problems_of(rows, TOPICS)
    assert (problem.row, problem.path, problem.is_warning) == (1, ("log", 0), False)


def test_an_input_may_be_bound_to_nothing_and_an_output_may_not() -> None:
    assert found(source(), listener(ports={"event": []})) == []
    assert found(source(ports={"given": []})) != []


def test_without_loading_classes_only_the_rows_themselves_are_checked() -> None:
    rows = [source(**{"class": "nowhere:Thing"}), source("b", standby_for="x")]
    assert [problem.path for problem in problems_of(rows, None, is_loading_classes=False)] == [("standby_for",)]


def test_two_standbys_of_one_primary_may_share_its_output() -> None:
    rows = [source(), *(source(name, standby_for="source", begin="quiet") for name in ("b", "c"))]
    assert found(*rows) == []


def test_an_input_takes_many_topics_by_a_pattern_or_a_list_and_a_key_makes_an_output_of_many() -> None:
    keyed = ComponentRow(name="keyed", class_name=f"{HERE}:Keyed", rate_hz=1.0, ports={"given": "to/{key}"})
    for ports in ("to/*", "to/someone", ["to/a", "given"]):
        rows = [source(), keyed, listener(ports={"given": ports, "event": "components/source/event"})]
        assert found(*rows) == []


def test_topics_that_come_from_elsewhere_can_be_named() -> None:
    rows = [listener(ports={"event": "news"})]
    assert len(found(*rows)) == 2
    assert list(problems_of(rows, TOPICS, external=["news", "given"])) == []


def test_a_row_is_checked_against_a_class_alone() -> None:
    (finding,) = check_row(source(ports={"x": "y"}), Source)
    assert finding.file == "component source"


@pytest.mark.parametrize(
    "entries",
    [{"name": "Has Space"}, {"rate_hz": 0.0}, {"rate_hz": 1e4}, {"timeout_s": -1.0}, {"begin": "sleeping"}, {"x": 1}],
)
def test_a_row_that_makes_no_sense_by_itself_is_refused(entries: dict[str, Any]) -> None:
    given = {"name": "source", "class": "a:B", **entries}
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(given, ComponentRow)


def test_a_class_is_loaded_and_made_with_its_devices() -> None:
    device = object()
    made = source().create({"d": device})
    assert isinstance(made, Source)
    assert made.device is device
    with pytest.raises(Gloc3Error, match="the host has no device 'd'; it has e"):
        source().create({"e": device})
    with pytest.raises(Gloc3Error, match="needs other devices"):
        source(devices={}).create({})
    with pytest.raises(Gloc3Error, match="is not a component class"):
        source(**{"class": "gloc3.component.lci:State"}).load_class()


def test_an_installed_component_is_found_where_its_module_was_before(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [EntryPoint("source", f"{HERE}:Source", "gloc3.components")]
    monkeypatch.setattr(deployment, "installed_points", lambda group: points)
    package = HERE.partition(".")[0]
    assert source(**{"class": f"{package}.before:Source"}).load_class() is Source
    for elsewhere in (f"{package}.before:Listener", "another.before:Source"):
        with pytest.raises(Gloc3Error, match="No module named"):
            source(**{"class": elsewhere}).load_class()


def test_a_device_that_the_host_does_not_have_comes_from_an_installed_package(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [EntryPoint("d", "io:BytesIO", "gloc3.devices"), EntryPoint("x", "nowhere:Thing", "gloc3.devices")]
    monkeypatch.setattr(deployment, "installed_points", lambda group: points)
    made = source().create({})
    assert isinstance(made, Source)
    assert isinstance(made.device, io.BytesIO)
    with pytest.raises(Gloc3Error, match="device 'x' cannot be made: No module named 'nowhere'"):
        source(devices={"device": "x"}).create({})
    with pytest.raises(Gloc3Error, match="the host has no device 'y'; it has d, x"):
        source(devices={"device": "y"}).create({})


def test_a_port_is_bound_to_its_own_name_if_nothing_else_is_said() -> None:
    assert listener().topics("given") == ["given"]
    assert listener().topics("event") == ["components/source/event"]
    assert Specimen.settings_type is not None


class Follower(Controller):  # type: ignore[type-arg]
    """Leads by numbers."""

    given = Input(Number)

    def work(self, now_s: float, inbox: Inbox) -> list[Number]:
        return []


@pytest.mark.parametrize(("name", "is_told"), [("Follower", True), ("Listener", False)])
def test_what_only_an_input_wakes_cannot_act_on_its_silence(name: str, is_told: bool) -> None:
    ports: dict[str, str | list[str]] = {} if name == "Follower" else {"event": "news"}
    row = ComponentRow(name="led", class_name=f"{HERE}:{name}", trigger="given", ports=ports)
    told = [finding for finding in check_row(row, row.load_class()) if "stops permanently" in finding.message]
    assert [finding.is_warning for finding in told] == [True] * is_told
    paced = msgspec.structs.replace(row, rate_hz=5.0)
    assert check_row(paced, row.load_class()) == []


def test_a_standby_that_reads_less_than_its_primary_is_found_at_its_ports() -> None:
    """A driver or a controller would do nothing after a take-over; of what estimates it may be meant."""
    both = {"given": ["given", "result"], "event": "components/source/event"}
    primary = listener(on_fault={"standby": "spare"}, ports=both)
    spare = listener("spare", standby_for="listener", begin="quiet", rate_hz=5.0)
    (text,) = [one for one in found(source(), primary, spare) if "does not read" in one]
    assert text.startswith("component spare: warning: ports: ")
    assert "spare does not read result, which listener reads as 'given'" in text
    assert "(bind 'given' as listener does: after a take-over nothing else reads it)" in text
    covering = listener("spare", standby_for="listener", begin="quiet", rate_hz=5.0, ports=both)
    assert not [one for one in found(source(), primary, covering) if "does not read" in one]
