"""Type hashes of ROS 2 (RIHS01): SHA-256 of a type's description in JSON, as rosidl computes it (REP 2016)."""

import json
import re
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from typing import Any, Final

from gloc3.ros2.definitions import DEFINITIONS

PREFIX: Final = "RIHS01_"
NESTED: Final = 1
PLACEHOLDER: Final = "structure_needs_at_least_one_member"
"""Field of a type without fields, in IDL."""
_IDS: Final = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
"""`type_description_interfaces/FieldType` of the types of `.msg` files."""
_ARRAY, _BOUNDED, _UNBOUNDED = 48, 96, 144
"""Added to the identifier of an element's type."""
_FIELD: Final = re.compile(r"(?P<kind>[\w/]+)(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?")
_SERVICE_PART: Final = re.compile(r"_(Request|Response|Event)$")


def full_name(kind: str) -> str:
    """`nav_msgs/msg/Odometry` of `nav_msgs/Odometry`; the parts of services are in `srv`."""
    package, _, name = kind.partition("/")
    return f"{package}/{'srv' if _SERVICE_PART.search(name) else 'msg'}/{name}"


@cache
def message_hash(kind: str) -> str:
    """The hash of a message type that has a definition, such as `nav_msgs/Odometry`."""
    return _hash(_description(kind), kind)


@cache
def service_hash(kind: str) -> str:
    """The hash of a service type whose request and response have definitions, such as `std_srvs/Trigger`."""
    package, _, name = kind.partition("/")
    parts = {
        "request_message": f"{kind}_Request",
        "response_message": f"{kind}_Response",
        "event_message": f"{kind}_Event",
    }
    fields = [_field(field, NESTED, nested=part) for field, part in parts.items()]
    return _hash({"type_name": f"{package}/srv/{name}", "fields": fields}, *parts.values())


def _hash(own: dict[str, Any], *roots: str) -> str:
    """The hash of a description.

    Args:
        own: the description.
        *roots: the types whose nested types it refers to, themselves included unless they are its own.
    """
    kinds = dict.fromkeys(roots)
    rest = [*roots]
    while rest:
        found = [one for one in _nested(rest.pop()) if one not in kinds]
        kinds |= dict.fromkeys(found)
        rest += found
    described = [_description(one) for one in kinds]
    others = sorted(
        (one for one in described if one["type_name"] != own["type_name"]), key=lambda one: one["type_name"]
    )
    text = json.dumps({"type_description": own, "referenced_type_descriptions": others})
    return PREFIX + sha256(text.encode()).hexdigest()


def _description(kind: str) -> dict[str, Any]:
    fields = [_field(*one) for one in _fields(kind)]
    return {"type_name": full_name(kind), "fields": fields or [_field(PLACEHOLDER, _IDS["uint8"])]}


def _nested(kind: str) -> list[str]:
    return [nested for *_, nested in _fields(kind) if nested]


def _fields(kind: str) -> Iterator[tuple[str, int, int, str]]:
    """Name, type identifier, capacity, and nested type of each field."""
    service, _, part = kind.rpartition("_")
    if part == "Event":
        yield "info", NESTED, 0, "service_msgs/ServiceEventInfo"
        yield "request", NESTED + _BOUNDED, 1, f"{service}_Request"
        yield "response", NESTED + _BOUNDED, 1, f"{service}_Response"
        return
    for line in DEFINITIONS[kind].splitlines():
        if not line or "=" in line.replace("<=", ""):
            continue  # a constant
        typed, name = line.split()[:2]
        found = _FIELD.fullmatch(typed)
        assert found is not None, line
        element, size = found["kind"], found["size"]
        offset = 0 if not found["array"] else _BOUNDED if found["bound"] else _ARRAY if size else _UNBOUNDED
        nested = "" if element in _IDS else element
        yield name, _IDS.get(element, NESTED) + offset, int(size or 0), nested


def _field(name: str, type_id: int, capacity: int = 0, nested: str = "") -> dict[str, Any]:
    kind = {
        "type_id": type_id,
        "capacity": capacity,
        "string_capacity": 0,
        "nested_type_name": full_name(nested) if nested else "",
    }
    return {"name": name, "type": kind}
