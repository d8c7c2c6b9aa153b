"""Every message of version 0.1 is read as it was meant, and its type has the same hash still."""

from collections.abc import Mapping
from typing import Any

import msgspec
import pytest

from gloc3.log.payloads import PayloadDecoder, PayloadEncoder
from gloc3.messages import wire
from gloc3.messages.command_interface import CiRequest, LoadMission, RequestBody
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.preflight import Verdict
from gloc3.messages.software import Software, compared
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import TypeRegistry, type_name

from .released import Example, examples

REGISTRY = TopicTable.installed().types
EXAMPLES = examples()


def holds(found: Any, meant: Any) -> bool:
    """Whether a value has everything that was meant: fields may have been appended since."""
    if isinstance(meant, Mapping):
        return isinstance(found, Mapping) and all(name in found and holds(found[name], meant[name]) for name in meant)
    if isinstance(meant, list):  # a structure that is an array may have got longer
        return len(found) >= len(meant) and all(map(holds, found, meant))
    return bool(found == meant)


def name_of(example: Example) -> str:
    """The type, and which request it is."""
    body = example.fields.get("body")
    return example.type.partition("#")[0] + (f"-{body[0]}" if body else "")


@pytest.mark.parametrize("example", EXAMPLES.messages, ids=name_of)
def test_a_message_of_0_1_is_read_with_all_its_fields(example: Example) -> None:
    envelope = REGISTRY.decode(example.bytes)
    assert envelope.type == example.type
    assert holds(msgspec.json.decode(msgspec.json.encode(envelope.payload)), example.fields)


@pytest.mark.parametrize("example", EXAMPLES.messages, ids=name_of)
def test_what_is_sent_now_begins_as_0_1_knows_it(example: Example) -> None:
    *head, payload = msgspec.msgpack.decode(example.bytes)
    *head_now, payload_now = msgspec.msgpack.decode(REGISTRY.encode(REGISTRY.decode(example.bytes)))
    assert head_now == head
    assert holds(payload_now, payload)


def test_the_requests_of_0_1_are_all_there() -> None:
    bodies = {example.fields["body"][0] for example in EXAMPLES.messages if example.type.startswith("CiRequest#")}
    assert len(bodies) == 21
    (kind,) = (kind for kind in REGISTRY if kind is CiRequest)
    assert type_name(kind) in {example.type for example in EXAMPLES.messages}


def test_a_mission_starts_between_this_version_and_0_1() -> None:
    """Where the pre-flight check of versions is red, a start is refused."""
    check = compared("station software", Software(EXAMPLES.version, EXAMPLES.protocol), "at station 255")
    assert check.verdict is not Verdict.RED, f"{check.finding}: {check.advice}"


# --- names that change ---


def define(name: str, *fields: Any) -> type[Message]:
    """A message type made at run time."""
    made = msgspec.defstruct(name, fields, bases=(Message,), frozen=True)
    assert issubclass(made, Message)
    return made


def registry(*kinds: type[Message]) -> TypeRegistry:
    """What a process knows."""
    made = TypeRegistry()
    for kind in kinds:
        made.add(kind)
    return made


ROW = msgspec.defstruct("Row", [("x", float)], frozen=True)
READING_ROW = msgspec.defstruct("ReadingRow", [("x", float)], frozen=True)


def before() -> type[Message]:
    """A message as it was released."""
    return define("Reading", ("level", float), ("rows", list[ROW]), ("unit", str, "m"))  # type: ignore[valid-type]


def after() -> type[Message]:
    """The same with another name of the class, of a class in it, and of two fields."""
    height = ("height_m", float, msgspec.field(name="level"))
    scale = ("scale", str, msgspec.field(name="unit", default="m"))
    return define("HeightReading", height, ("rows", list[READING_ROW]), scale)  # type: ignore[valid-type]


@pytest.fixture
def _former_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "FORMER_NAMES", {"HeightReading": "Reading", "ReadingRow": "Row"})


def envelope_of(message: Message) -> Envelope[Any]:
    """A message on its way."""
    return Envelope("p/t", Source("p", "c", 1), 3, 1.5, "", type_name(type(message)), message)


@pytest.mark.usefixtures("_former_names")
def test_a_renamed_message_keeps_its_type_and_is_read_under_its_former_name() -> None:
    previous, new = before(), after()
    assert type_name(new) == type_name(previous)
    sent = envelope_of(previous(level=1.0, rows=[ROW(x=2.0)], unit="ft"))
    received = registry(new).decode(registry(previous).encode(sent))
    assert type(received.payload) is new
    assert msgspec.structs.asdict(received.payload)["height_m"] == 1.0
    back = registry(previous).decode(registry(new).encode(received))
    assert type(back.payload) is previous
    assert (back.payload.level, back.payload.unit) == (1.0, "ft")  # type: ignore[attr-defined]


def test_a_message_that_is_renamed_without_a_former_name_is_unknown() -> None:
    sent = registry(before()).encode(envelope_of(before()(level=1.0, rows=[])))
    with pytest.raises(wire.WireError, match="unknown message type 'Reading'"):
        registry(after()).decode(sent)


@pytest.mark.usefixtures("_former_names")
def test_a_log_knows_a_renamed_message_and_its_fields_by_their_former_names() -> None:
    previous, new = before(), after()
    written = PayloadEncoder(previous).encode(envelope_of(previous(level=1.0, rows=[])), 0)
    restored = PayloadDecoder(new).decode(written).payload
    assert type(restored) is new
    assert restored.height_m == 1.0  # type: ignore[attr-defined]
    assert PayloadEncoder(new).encode(envelope_of(restored), 0) == written
    assert PayloadEncoder(new).schema[0] == PayloadEncoder(previous).schema[0] == "gloc3.Reading"


def test_a_renamed_request_keeps_its_tag(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "FORMER_NAMES", {"LoadPlan": "LoadMission"})

    class LoadPlan(RequestBody, frozen=True):
        name: str
        text: str
        amends: str = ""

    assert msgspec.json.encode(LoadPlan(name="n", text="t")) == msgspec.json.encode(LoadMission(name="n", text="t"))
