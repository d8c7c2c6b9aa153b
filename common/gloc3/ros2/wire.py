"""The wire of `rmw_zenoh`: keys of topics and services, liveliness tokens, quality of service, attachments.

By the design document of rmw_zenoh (`docs/design.md` of github.com/ros2/rmw_zenoh) and its sources. Topics and services
are keys `DOMAIN/NAME/TYPE/HASH`. Every node, publisher, subscription, service server and client declares a token below
`@ros2_lv`. Every message and request carries an attachment: sequence number, time, and the sender's identifier.
"""

import re
import struct
from enum import StrEnum
from typing import Final, NamedTuple

from xxhash import xxh3_128_intdigest

from gloc3.errors import Refused

ROUTER: Final = "tcp/localhost:7447"
"""Where `ros2 run rmw_zenoh_cpp rmw_zenohd` listens."""
TOKENS: Final = "@ros2_lv"
NO_HASH: Final = "TypeHashNotSupported"
"""In place of a type's hash: of ROS 2 Humble, which has none."""
DEFAULT_DEPTH: Final = 42
GID_BYTES: Final = 16
_ATTACHMENT: Final = struct.Struct(f"<qqB{GID_BYTES}s")
"""Zenoh's serialization of two 64-bit integers and a sequence of bytes, whose length fits into a byte."""
_NAME: Final = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_QOS: Final = re.compile(r"(?P<reliability>\d*):(?P<durability>\d*):(?P<history>\d*),(?P<depth>\d*)(:.*)?")


class Qos(NamedTuple):
    """Quality of service. With Zenoh any two kinds match; it tells others what to expect."""

    is_reliable: bool = True
    is_latched: bool = False
    """Transient local: who comes late gets the last messages."""
    depth: int = 10
    """Messages that are kept."""

    def __str__(self) -> str:
        reliability, durability = "" if self.is_reliable else "2", "1" if self.is_latched else ""
        depth = "" if self.depth == DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:,{depth}:,:,:,,"


SENSOR: Final = Qos(is_reliable=False, depth=5)
STATE: Final = Qos()
LATCHED: Final = Qos(is_latched=True, depth=1)
SERVICE: Final = Qos()


class EntityKind(StrEnum):
    """Kinds of entities of the ROS graph."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVER = "SS"
    CLIENT = "SC"


class RosEndpoint(NamedTuple):
    """A topic or a service, by name and type."""

    name: str
    """Absolute: `/pelican/pose`."""
    type: str
    """As declared in DDS: `nav_msgs::msg::dds_::Odometry_`."""
    hash: str

    def key(self, domain: int) -> str:
        """Its key expression."""
        return f"{domain}/{self.name.strip('/')}/{self.type}/{self.hash}"


class Entity(NamedTuple):
    """An entity of the ROS graph, as its token describes it."""

    domain: int
    session: str
    """The Zenoh session's identifier."""
    node_id: int
    """Number of the node in its session."""
    id: int
    """Number of the entity in its session; of a node that of the node."""
    kind: EntityKind
    namespace: str
    """Absolute; `/` for none."""
    node: str
    endpoint: RosEndpoint | None = None
    """None for a node."""
    qos: Qos = Qos()

    @property
    def node_name(self) -> str:
        """The node's absolute name."""
        return f"{self.namespace.rstrip('/')}/{self.node}"

    @property
    def token(self) -> str:
        """Its liveliness token; the enclave is always the default one."""
        parts = [TOKENS, self.domain, self.session, self.node_id, self.id, self.kind.value, "%"]
        parts += [_mangled(self.namespace), self.node]
        if self.endpoint is not None:
            parts += [_mangled(self.endpoint.name), self.endpoint.type, self.endpoint.hash, self.qos]
        return "/".join(map(str, parts))

    @property
    def servers(self) -> str:
        """The tokens of the servers of a client's service."""
        assert self.endpoint is not None
        kind, name = EntityKind.SERVER.value, _mangled(self.endpoint.name)
        return f"{TOKENS}/{self.domain}/*/*/*/{kind}/*/*/*/{name}/{self.endpoint.type}/{self.endpoint.hash}/*"

    @property
    def gid(self) -> bytes:
        """Its global identifier: XXH3 of the token, 128 bits, the lower half first."""
        return xxh3_128_intdigest(self.token.encode()).to_bytes(GID_BYTES, "little")


class MessageHead(NamedTuple):
    """The attachment of a message, a request or a response."""

    sequence: int
    """Counts the publisher's messages or the client's requests."""
    utc_ns: int
    """When it was sent."""
    gid: bytes
    """Of the publisher or the client."""

    def encode(self) -> bytes:
        """Its 33 bytes."""
        return _ATTACHMENT.pack(self.sequence, self.utc_ns, GID_BYTES, self.gid)


def decode_head(data: bytes) -> MessageHead | None:
    """The attachment; None if it is none of rmw_zenoh's."""
    if len(data) != _ATTACHMENT.size:
        return None
    sequence, utc_ns, length, gid = _ATTACHMENT.unpack(data)
    return MessageHead(sequence, utc_ns, gid) if length == GID_BYTES else None


def dds_name(kind: str, *, is_service: bool = False) -> str:
    """`nav_msgs::msg::dds_::Odometry_` of `nav_msgs/Odometry`."""
    package, _, name = kind.partition("/")
    return f"{package}::{'srv' if is_service else 'msg'}::dds_::{name}_"


def absolute(name: str) -> str:
    """An absolute name of a topic, service or node.

    Raises:
        Refused: ROS does not allow it.
    """
    found = f"/{name.strip('/')}"
    if _NAME.fullmatch(found) is None or "__" in found:
        raise Refused(f"{name!r} is no name in ROS: write letters, digits and single _, such as /odometry/filtered")
    return found


def parse_token(text: str) -> Entity | None:
    """The entity of a token; None if it is none of rmw_zenoh's."""
    parts = text.split("/")
    if len(parts) not in (9, 13) or parts[0] != TOKENS or "" in parts[:12]:
        return None
    try:
        kind = EntityKind(parts[5])
        domain, node_id, number = int(parts[1]), int(parts[3]), int(parts[4])
    except ValueError:
        return None
    if (kind is EntityKind.NODE) != (len(parts) == 9):
        return None
    node = Entity(domain, parts[2], node_id, number, kind, _demangled(parts[7]), _demangled(parts[8]))
    if kind is EntityKind.NODE:
        return node
    qos = _parse_qos(parts[12])
    endpoint = RosEndpoint(_demangled(parts[9]), _demangled(parts[10]), parts[11])
    return None if qos is None else node._replace(endpoint=endpoint, qos=qos)


def _parse_qos(text: str) -> Qos | None:
    found = _QOS.fullmatch(text)
    if found is None:
        return None
    depth = int(found["depth"]) if found["depth"] else DEFAULT_DEPTH
    return Qos(found["reliability"] != "2", found["durability"] == "1", depth)


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _demangled(name: str) -> str:
    return name.replace("%", "/")
