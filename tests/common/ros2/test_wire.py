"""The wire of rmw_zenoh, against examples of its design document, and types against other implementations."""

from array import array
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros2_pyterfaces.core import hash_rihs01
from ros2_pyterfaces.core.lifecycle_msgs import srv as lifecycle
from ros2_pyterfaces.core.service_msgs import msg as service
from ros2_pyterfaces.core.std_srvs import srv as standard
from rosbags.typesys import Stores, get_typestore
from tests.ros_peer import STORE
from zenoh.ext import Int64, z_serialize

from gloc3.errors import Refused
from gloc3.ros2.cdr import decoder, encoder
from gloc3.ros2.definitions import DEFINITIONS
from gloc3.ros2.type_hash import full_name, message_hash, service_hash
from gloc3.ros2.wire import (
    NO_HASH,
    SENSOR,
    SERVICE,
    EntityKind,
    MessageHead,
    Qos,
    RosEndpoint,
    absolute,
    dds_name,
    decode_head,
    parse_token,
)

STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TALKER = f"8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{STRING}"
ADDER = (
    "f9980ee0495eaafb3e38f0d19e2eae12/0/10/SS/%/%/add_two_ints_server/%add_two_ints/example_interfaces::srv::dds_::"
    "AddTwoInts_/RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
)
TOKENS = [
    "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener",
    f"@ros2_lv/2/{TALKER}/::,7:,:,:,,",
    f"@ros2_lv/2/{ADDER}/::,10:,:,:,,",
]
"""Examples of the design document of rmw_zenoh."""


@pytest.mark.parametrize("token", TOKENS)
def test_tokens_of_the_design_document_are_read_and_written(token: str) -> None:
    entity = parse_token(token)
    assert entity is not None
    assert entity.token == token


def test_a_token_says_who_publishes_what() -> None:
    talker = parse_token(TOKENS[1])
    assert talker is not None
    assert (talker.domain, talker.kind, talker.node_name) == (2, EntityKind.PUBLISHER, "/talker")
    assert talker.endpoint == RosEndpoint("/chatter", "std_msgs::msg::dds_::String_", STRING)
    assert talker.endpoint.key(0) == f"0/chatter/std_msgs::msg::dds_::String_/{STRING}"
    assert RosEndpoint("/robot1/chatter", talker.endpoint.type, STRING).key(0).startswith("0/robot1/chatter/std_msgs")
    assert talker.qos == Qos(depth=7)
    assert len(talker.gid) == 16


@pytest.mark.parametrize(
    "token",
    [
        "",
        TOKENS[0].replace("@ros2_lv", "@gloc3"),
        TOKENS[0].replace("/NN/", "/XX/"),
        TOKENS[0].replace("/2/", "/two/"),
        TOKENS[0].replace("/NN/", "/MP/"),
        TOKENS[1].removesuffix("/::,7:,:,:,,"),
        TOKENS[1].replace("::,7", "many"),
    ],
)
def test_what_is_no_token_is_none(token: str) -> None:
    assert parse_token(token) is None


@pytest.mark.parametrize(
    ("qos", "text"),
    [(SERVICE, "::,10:,:,:,,"), (SENSOR, "2::,5:,:,:,,"), (Qos(is_latched=True, depth=42), ":1:,:,:,:,,")],
)
def test_quality_of_service_is_what_differs_from_the_default(qos: Qos, text: str) -> None:
    assert str(qos) == text
    found = parse_token(f"@ros2_lv/2/{TALKER}/{text}")
    assert found is not None
    assert found.qos == qos


def test_an_attachment_is_zenohs_serialization_of_its_parts() -> None:
    attachment = MessageHead(7, 1_795_865_376_746_307_584, bytes(range(16)))
    data = attachment.encode()
    parts = [Int64(attachment.sequence), Int64(attachment.utc_ns), attachment.gid]
    assert data == b"".join(z_serialize(part).to_bytes() for part in parts)
    assert decode_head(data) == attachment
    assert decode_head(data[:-1]) is None
    assert decode_head(data[:16] + b"\x0f" + data[17:]) is None


def test_names_are_those_that_ros_allows() -> None:
    assert absolute("odometry/filtered") == absolute("/odometry/filtered") == "/odometry/filtered"
    for name in ("", "/", "front-camera", "a//b", "1st", "a__b", "a b"):
        with pytest.raises(Refused, match="is no name in ROS"):
            absolute(name)
    assert dds_name("std_srvs/Trigger", is_service=True) == "std_srvs::srv::dds_::Trigger_"


@pytest.mark.parametrize("store", [Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL])
def test_types_have_the_hashes_of_every_distribution_that_has_hashes(store: Stores) -> None:
    types = get_typestore(store)
    known = [kind for kind in DEFINITIONS if full_name(kind) in types.types]
    assert len(known) >= 30
    known.remove("service_msgs/ServiceEventInfo")  # rosbags takes char for a signed integer, rosidl for an unsigned one
    assert {kind: message_hash(kind) for kind in known} == {kind: types.hash_rihs01(full_name(kind)) for kind in known}


def test_services_have_the_hashes_that_another_implementation_computes() -> None:
    kinds = {
        "std_srvs/Trigger": standard.Trigger,
        "lifecycle_msgs/ChangeState": lifecycle.ChangeState,
        "lifecycle_msgs/GetState": lifecycle.GetState,
    }
    assert {kind: service_hash(kind) for kind in kinds} == {kind: hash_rihs01(one) for kind, one in kinds.items()}
    assert message_hash("service_msgs/ServiceEventInfo") == hash_rihs01(service.ServiceEventInfo)
    assert service_hash("std_srvs/Trigger").endswith("eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f")
    assert NO_HASH not in map(message_hash, DEFINITIONS)


def sample(kind: str) -> dict[str, Any]:
    """A message with other values in all its fields."""
    found: dict[str, Any] = {}
    for number, line in enumerate(filter(None, DEFINITIONS[kind].splitlines()), 1):
        typed, name = line.split()[:2]
        element, _, size = typed.rstrip("]").partition("[")
        if "=" in line:
            continue
        one = sample(element) if element in DEFINITIONS else f"höhe {number}" if element == "string" else number
        many = [one] * int(size or 2)
        found[name] = one if "[" not in typed else many if isinstance(one, dict | str) else ARRAYS[element](many)
    return found


ARRAYS: dict[str, Callable[[Any], Any]] = {
    "float32": lambda many: array("f", many),
    "float64": list,
    "uint8": bytes,
    "char": list,
}


def plain(message: Any) -> Any:
    """A message of any library as dictionaries and lists."""
    if isinstance(message, bytes | array | np.ndarray):
        return list(message)
    if isinstance(message, list):
        return [plain(one) for one in message]
    names = getattr(message, "__slots__", None) or vars(message) if hasattr(message, "__dict__") else None
    if names is None:
        return message
    return {name: plain(getattr(message, name)) for name in names if name.islower() and name != "__msgtype__"}


MESSAGES = [kind for kind in DEFINITIONS if full_name(kind) in STORE.types and kind != "service_msgs/ServiceEventInfo"]


@pytest.mark.parametrize("kind", MESSAGES)
def test_messages_are_the_bytes_of_rosbags(kind: str) -> None:
    data = encoder(kind)(sample(kind))
    read = STORE.deserialize_cdr(data, full_name(kind))
    assert plain(read) == plain(decoder(kind)(data))
    assert STORE.serialize_cdr(read, full_name(kind)) == data


def test_a_type_without_fields_is_a_byte() -> None:
    assert encoder("std_srvs/Trigger_Request")({}) == b"\x00\x01\x00\x00\x00"


@given(st.sampled_from(MESSAGES), st.binary(max_size=200))
def test_bytes_that_are_no_message_are_refused(kind: str, data: bytes) -> None:
    with suppress(Refused):
        decoder(kind)(b"\x00\x01\x00\x00" + data)
    with pytest.raises(Refused, match=f"{len(data[:3])} bytes are no {kind}"):
        decoder(kind)(data[:3])
