"""The wire format: every message comes back as it was, and bytes from elsewhere never do harm."""

from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.any_message import TEXTS, structures

from gloc3.errors import Misuse
from gloc3.messages.envelope import CommandRequest, ComponentStatus, Envelope, Kind, Message, Source
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Image
from gloc3.messages.wire import TypeRegistry, VersionsDiffer, WireError, from_array, to_array, type_name

pytestmark = pytest.mark.thorough

REGISTRY = TopicTable.installed().types
TYPES = sorted(REGISTRY, key=lambda kind: kind.__name__)


def envelope_of(message: Message, **entries: Any) -> Envelope[Any]:
    """A message on its way."""
    known = {"topic": "p/t", "source": Source("p", "c", 1), "sequence": 3, "t_s": 1.5, "frame": "ned"}
    return Envelope(**{**known, **entries}, type=type_name(type(message)), payload=message)


def decode(data: bytes) -> Envelope[Any] | None:
    """The envelope in some bytes, or None where they are refused as they should be."""
    try:
        return REGISTRY.decode(data)
    except WireError:
        return None


ENVELOPES = st.sampled_from(TYPES).flatmap(structures).map(envelope_of)


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_every_registered_message_comes_back_as_it_was(kind: type[Message]) -> None:
    @settings(max_examples=4, derandomize=True, database=None)
    @given(
        structures(kind),
        st.floats(allow_nan=False),
        TEXTS,
        st.integers(0, 2**53),
    )
    def check(message: Message, t_s: float, text: str, sequence: int) -> None:
        sent = envelope_of(message, t_s=t_s, frame=text, sequence=sequence, source=Source(text, "c", 2**32 - 1))
        data = REGISTRY.encode(sent)
        assert repr(REGISTRY.decode(data)) == repr(sent)  # repr, because NaN is not equal to itself
        assert data.endswith(msgspec.msgpack.encode(to_array(message)))

    check()


@settings(max_examples=50)
@given(ENVELOPES, st.data())
def test_damaged_bytes_are_refused_and_never_raise_anything_else(envelope: Envelope[Any], data: st.DataObject) -> None:
    raw = bytearray(REGISTRY.encode(envelope))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(raw) - 1))
        match data.draw(st.sampled_from(["flip", "cut", "insert"])):
            case "flip":
                raw[place] ^= data.draw(st.integers(1, 255))
            case "cut":
                del raw[place : place + data.draw(st.integers(1, 40))]
            case _:
                raw[place:place] = data.draw(st.binary(min_size=1, max_size=8))
        if not raw:
            break
    decode(bytes(raw))


@settings(max_examples=50)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_and_never_raise_anything_else(raw: bytes) -> None:
    decode(raw)


@settings(max_examples=50)
@given(
    st.sampled_from(TYPES),
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | TEXTS | st.binary(max_size=4),
        lambda inner: st.lists(inner, max_size=5) | st.dictionaries(TEXTS, inner, max_size=2),
        max_leaves=12,
    ),
)
def test_well_formed_bytes_that_do_not_fit_their_type_are_refused(kind: type[Message], payload: Any) -> None:
    parts = ("p/t", ("p", "c", 1), 0, 0.0, "", type_name(kind), [payload] if not isinstance(payload, list) else payload)
    found = decode(msgspec.msgpack.encode(parts))
    assert found is None or isinstance(found.payload, kind)


def test_many_bytes_travel_beside_their_message_by_reference() -> None:
    picture = Image(camera="front", width=200, height=100, data=bytes(range(200)) * 100, reason="dark")
    sent = envelope_of(picture)
    apart = REGISTRY.encode_apart(sent)
    assert apart is not None
    head, body = apart
    assert len(head) < 100
    assert body is picture.data
    assert REGISTRY.decode(head, body) == sent
    small = envelope_of(msgspec.structs.replace(picture, data=b"few"))
    assert REGISTRY.encode_apart(small) is None
    assert REGISTRY.encode_apart(envelope_of(status())) is None
    with pytest.raises(WireError, match="no field of many bytes"):
        REGISTRY.decode(REGISTRY.encode(envelope_of(status())), body)


def test_deeply_nested_bytes_are_refused() -> None:
    deep = b"\x91" * 100_000 + b"\xc0"
    assert decode(deep) is None
    head = msgspec.msgpack.encode(("p/t", ("p", "c", 1), 0, 0.0, "", type_name(CommandRequest), ["id", "c"]))
    assert decode(head[:-5] + deep) is None


def status(**entries: Any) -> ComponentStatus:
    """A component's health."""
    return ComponentStatus(name="pose", kind=Kind.PROCESSOR, state=None, **entries)


def test_on_the_wire_a_message_is_an_array_without_names() -> None:
    array = to_array(status(rate_hz=20.0))
    assert array[:4] == ["pose", "DP", None, 20.0]
    assert len(msgspec.msgpack.encode(array)) < 130


def test_fields_that_a_sender_does_not_know_take_their_defaults_and_those_that_we_do_not_know_are_cut() -> None:
    array = to_array(status(rate_hz=20.0))
    assert from_array(array[:4], ComponentStatus) == status(rate_hz=20.0)
    assert from_array([*array, "from the future", 1], ComponentStatus) == status(rate_hz=20.0)


def test_an_array_that_lacks_the_fixed_part_is_refused() -> None:
    with pytest.raises(WireError, match="ComponentStatus"):
        from_array(["pose"], ComponentStatus)


def define(name: str, *fields: Any) -> type[Message]:
    """A message type made at run time."""
    made = msgspec.defstruct(name, fields, bases=(Message,), frozen=True)
    assert issubclass(made, Message)
    return made


def test_the_hash_covers_the_fixed_part_alone() -> None:
    first = define("Reading", ("value", float))
    appended = define("Reading", ("value", float), ("quality", float, 1.0))
    renamed = define("Reading", ("level", float))
    retyped = define("Reading", ("value", int))
    grown = define("Reading", ("value", float), ("unit", str))
    assert type_name(first) == type_name(appended)
    assert len({type_name(kind) for kind in (first, renamed, retyped, grown)}) == 4


def test_the_hash_looks_into_nested_structures_and_takes_every_annotation() -> None:
    inner = msgspec.defstruct("Inner", [("x", float)], frozen=True, array_like=True)
    other = msgspec.defstruct("Inner", [("y", float)], frozen=True, array_like=True)
    assert type_name(define("Outer", ("inner", list[inner]))) != type_name(define("Outer", ("inner", list[other])))  # type: ignore[valid-type]
    odd = define(
        "Odd",
        ("choice", Literal["a", "b"]),
        ("ranged", Annotated[int, msgspec.Meta(ge=0)]),
        ("maybe", float | None),
        ("pair", tuple[int, ...]),
        ("table", dict[str, int]),
    )
    registry = TypeRegistry()
    registry.add(odd)
    message = odd(choice="a", ranged=1, maybe=None, pair=(1, 2), table={"x": 1})
    assert registry.decode(registry.encode(envelope_of(message))).payload == message


def test_another_fixed_part_at_the_other_end_is_versions_differ() -> None:
    there, here = TypeRegistry(), TypeRegistry()
    there.add(define("Reading", ("value", int)))
    here.add(define("Reading", ("value", float)))
    (kind,) = there
    with pytest.raises(VersionsDiffer, match="versions differ: Reading#"):
        here.decode(there.encode(envelope_of(kind(value=1))))


def test_an_unknown_type_is_refused() -> None:
    stranger = define("Stranger", ("value", int))
    with pytest.raises(WireError, match="unknown message type 'Stranger'"):
        REGISTRY.decode(REGISTRY.encode(envelope_of(stranger(value=1))))


def test_two_types_of_one_name_are_a_mistake() -> None:
    registry = TypeRegistry()
    registry.add(define("Reading", ("value", int)))
    with pytest.raises(Misuse, match="two message types are called Reading"):
        registry.add(define("Reading", ("value", float)))


def test_the_name_of_a_type_is_the_same_in_every_process_and_release() -> None:
    assert type_name(CommandRequest) == "CommandRequest#ce41f4"
    assert all(len(type_name(kind).partition("#")[2]) == 6 for kind in TYPES)
