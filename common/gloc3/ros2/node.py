"""A node of ROS 2 on the wire of `rmw_zenoh`: publishers, subscriptions, service servers and clients.

ROS 2 need not be installed. The node is a Zenoh peer as rmw_zenoh's own: it connects to the router, which introduces the
peers to each other, and listens on loopback only. What it calls back runs in threads of Zenoh's.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from threading import Event, Lock
from typing import Any, Final

import msgspec
import zenoh
from zenoh.ext import CacheConfig, HistoryConfig, MissDetectionConfig, declare_advanced_publisher
from zenoh.ext import declare_advanced_subscriber as declare_subscriber

from gloc3.clock import utc_now
from gloc3.errors import Gloc3Error, Refused
from gloc3.ros2.cdr import decoder, encoder
from gloc3.ros2.messages import RosMessage
from gloc3.ros2.type_hash import message_hash, service_hash
from gloc3.ros2.wire import (
    NO_HASH,
    ROUTER,
    SERVICE,
    TOKENS,
    Entity,
    EntityKind,
    MessageHead,
    Qos,
    RosEndpoint,
    absolute,
    dds_name,
    decode_head,
    parse_token,
)

HEARTBEAT_S: Final = 0.5
"""Period at which a latched publisher announces its last message to those that may have missed it, s."""
ANSWER_S: Final = 5.0
"""Default time for the response of a service, s."""
REASONS_KEPT: Final = 32
"""Different reasons for which messages are not accepted; others send the messages, so there may be any number."""
SERVED_S: Final = 0.1
"""Period at which a client looks for a server, s."""


class RosNetwork(msgspec.Struct, frozen=True, kw_only=True):
    """Where the nodes of ROS 2 are."""

    router: str = ROUTER
    """Zenoh endpoint of the router."""
    domain: int = 0
    """`ROS_DOMAIN_ID`."""
    is_humble: bool = False
    """The distribution has no type hashes."""
    config: Path | None = None
    """A Zenoh configuration in place of the router's endpoint, such as for TLS (`ZENOH_SESSION_CONFIG_URI`)."""


class Received(msgspec.Struct, frozen=True):
    """A message that was received."""

    message: Any
    """Its fields are attributes."""
    head: MessageHead


class RosPublisher:
    """Publishes messages of one type on one topic."""

    def __init__(self, put: Callable[[bytes, bytes], None], encode: Callable[[RosMessage], bytes], gid: bytes) -> None:
        self._put, self._encode, self._gid = put, encode, gid
        self._sequence = count(1)

    def publish(self, message: RosMessage) -> None:
        """Sends a message; from any thread."""
        head = MessageHead(next(self._sequence), _utc_ns(), self._gid)
        self._put(self._encode(message), head.encode())


class RosClient:
    """Calls one service."""

    def __init__(self, session: zenoh.Session, entity: Entity, kind: str) -> None:
        self._session, self._kind = session, kind
        self._entity, self._sequence = entity, count(1)

    def call(self, request: RosMessage, within_s: float = ANSWER_S) -> Any:
        """Calls the service and waits for its response, whose fields are attributes.

        Raises:
            Refused: nobody serves it, or there is no answer in time, or one that cannot be read.
        """
        entity = self._entity
        assert entity.endpoint is not None
        self._await_server(within_s)
        head, begin_ns, pause = MessageHead(next(self._sequence), _utc_ns(), entity.gid), _utc_ns(), Event()
        payload, was_received = encoder(f"{self._kind}_Request")(request), False
        # Its token may be here before its queryable: what ends at once without a reply has reached nobody.
        while not was_received and (left_s := within_s - (_utc_ns() - begin_ns) * 1e-9) > 0.0:
            replies = self._session.get(
                entity.endpoint.key(entity.domain),
                payload=payload,
                attachment=head.encode(),
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=left_s,
            )
            for reply in replies:
                if reply.ok is not None:
                    return decoder(f"{self._kind}_Response")(reply.ok.payload.to_bytes())
                was_received = True
            pause.wait(SERVED_S)
        raise Refused(f"service {entity.endpoint.name} does not answer within {within_s:g} s")

    def _await_server(self, within_s: float) -> None:
        """Waits until a server is there: a request that is sent before reaches nobody."""
        pause, liveliness = Event(), self._session.liveliness()
        for _ in range(max(1, round(within_s / SERVED_S))):
            if any(reply.ok is not None for reply in liveliness.get(self._entity.servers, timeout=within_s)):
                return
            pause.wait(SERVED_S)
        assert self._entity.endpoint is not None
        raise Refused(f"nobody serves {self._entity.endpoint.name}, {self._entity.endpoint.type}")


class RosNode:
    """One node, with all that it has declared; `open_node` opens it.

    Args:
        session: the Zenoh session.
        network: where it is.
        name: its absolute name.
    """

    def __init__(self, session: zenoh.Session, network: RosNetwork, name: str) -> None:
        self._session, self.network = session, network
        namespace, _, node = absolute(name).rpartition("/")
        zid = str(session.info.zid())
        self._entity: Final = Entity(network.domain, zid, 0, 0, EntityKind.NODE, namespace or "/", node)
        self._numbers = count(1)
        self._tokens = [session.liveliness().declare_token(self._entity.token)]
        self._declared: list[Any] = []
        self._lock = Lock()
        self.problems: dict[str, int] = {}
        """Messages that were not accepted, by the reason."""

    @property
    def name(self) -> str:
        """Its absolute name."""
        return self._entity.node_name

    @property
    def is_connected(self) -> bool:
        """Whether a router, or a peer, is there."""
        return bool(self._session.info.routers_zid() or self._session.info.peers_zid())

    def publisher(self, topic: str, kind: str, qos: Qos) -> RosPublisher:
        """Declares a publisher.

        Args:
            topic: absolute name.
            kind: type of the messages, such as `nav_msgs/Odometry`.
            qos: quality of service.

        Raises:
            Refused: the name is not allowed.
        """
        entity = self._entity_of(EntityKind.PUBLISHER, self._topic(topic, kind), qos)
        reliability = zenoh.Reliability.RELIABLE if qos.is_reliable else zenoh.Reliability.BEST_EFFORT
        latched: dict[str, Any] = {}
        if qos.is_latched:
            latched = {
                "cache": CacheConfig(qos.depth),
                "publisher_detection": True,
                "sample_miss_detection": MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
            }
        publisher = declare_advanced_publisher(
            self._session,
            self._key(entity),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=reliability,
            **latched,
        )
        self._declare(publisher, entity)

        def put(data: bytes, head: bytes) -> None:
            publisher.put(data, attachment=head)

        return RosPublisher(put, encoder(kind), entity.gid)

    def subscribe(self, topic: str, kind: str, receive: Callable[[Received], None], qos: Qos) -> None:
        """Declares a subscription. Messages of another version of the type are counted, not decoded.

        Args:
            topic: absolute name.
            kind: type of the messages.
            receive: called in a thread of Zenoh's.
            qos: quality of service.

        Raises:
            Refused: the name is not allowed.
        """
        endpoint = self._topic(topic, kind)
        entity = self._entity_of(EntityKind.SUBSCRIPTION, endpoint, qos)
        decode, accepted = decoder(kind), (message_hash(kind), NO_HASH)

        def handle(sample: zenoh.Sample) -> None:
            found = str(sample.key_expr).rpartition("/")[2]
            head = decode_head(sample.attachment.to_bytes()) if sample.attachment is not None else None
            if found not in accepted:
                self._count(f"{topic}: another version of {kind}, {found[:16]}…")
            elif head is None:
                self._count(f"{topic}: a message without an attachment of rmw_zenoh")
            else:
                try:
                    message = decode(sample.payload.to_bytes())
                except Refused as refusal:
                    self._count(f"{topic}: {refusal}")
                else:
                    receive(Received(message, head))

        history = HistoryConfig(detect_late_publishers=True, max_samples=qos.depth) if qos.is_latched else None
        key = endpoint._replace(hash="*").key(self.network.domain)
        self._declare(
            declare_subscriber(self._session, key, handle, history=history, subscriber_detection=qos.is_latched), entity
        )

    def serve(self, service: str, kind: str, handle: Callable[[Any, Callable[[RosMessage], None]], None]) -> None:
        """Declares a service server.

        Args:
            service: absolute name.
            kind: type of the service, such as `std_srvs/Trigger`.
            handle: called in a thread of Zenoh's with the request, whose fields are attributes, and what takes the
                response, once, from any thread.

        Raises:
            Refused: the name is not allowed.
        """
        entity = self._entity_of(EntityKind.SERVER, self._service(service, kind), SERVICE)
        decode, encode, key = decoder(f"{kind}_Request"), encoder(f"{kind}_Response"), self._key(entity)

        def receive(query: zenoh.Query) -> None:
            head = decode_head(query.attachment.to_bytes()) if query.attachment is not None else None
            try:
                if head is None:
                    raise Refused("a request without an attachment of rmw_zenoh")
                request = decode(query.payload.to_bytes() if query.payload is not None else b"")
            except Refused as refusal:
                self._count(f"{service}: {refusal}")
                with query:
                    query.reply_err(str(refusal))
                return
            handle(request, partial(respond, query, head))

        def respond(query: zenoh.Query, head: MessageHead, response: RosMessage) -> None:
            with query:
                query.reply(key, encode(response), attachment=head._replace(utc_ns=_utc_ns()).encode())

        self._declare(self._session.declare_queryable(key, receive, complete=True), entity)

    def client(self, service: str, kind: str) -> RosClient:
        """Declares a service client.

        Args:
            service: absolute name.
            kind: type of the service.

        Raises:
            Refused: the name is not allowed.
        """
        entity = self._entity_of(EntityKind.CLIENT, self._service(service, kind), SERVICE)
        self._declare(None, entity)
        return RosClient(self._session, entity, kind)

    def watch(self, changed: Callable[[Entity, bool], None]) -> None:
        """Has `changed` called, in a thread of Zenoh's, with every entity of the graph that appears or leaves."""

        def handle(sample: zenoh.Sample) -> None:
            entity = parse_token(str(sample.key_expr))
            if entity is not None:
                changed(entity, sample.kind == zenoh.SampleKind.PUT)

        key = f"{TOKENS}/{self.network.domain}/**"
        self._declared.append(self._session.liveliness().declare_subscriber(key, handle, history=True))

    def close(self) -> None:
        """Leaves the graph."""
        for declared in (*self._declared, *self._tokens):
            declared.undeclare()
        self._declared.clear()
        self._tokens.clear()

    def _topic(self, name: str, kind: str) -> RosEndpoint:
        return RosEndpoint(absolute(name), dds_name(kind), NO_HASH if self.network.is_humble else message_hash(kind))

    def _service(self, name: str, kind: str) -> RosEndpoint:
        found = NO_HASH if self.network.is_humble else service_hash(kind)
        return RosEndpoint(absolute(name), dds_name(kind, is_service=True), found)

    def _entity_of(self, kind: EntityKind, endpoint: RosEndpoint, qos: Qos) -> Entity:
        return self._entity._replace(id=next(self._numbers), kind=kind, endpoint=endpoint, qos=qos)

    def _key(self, entity: Entity) -> str:
        assert entity.endpoint is not None
        return entity.endpoint.key(self.network.domain)

    def _declare(self, declared: Any, entity: Entity) -> None:
        """Keeps what was declared, and announces it."""
        if declared is not None:
            self._declared.append(declared)
        self._tokens.append(self._session.liveliness().declare_token(entity.token))

    def _count(self, reason: str) -> None:
        with self._lock:
            if reason not in self.problems and len(self.problems) >= REASONS_KEPT:
                reason = "further messages are not accepted"
            self.problems[reason] = self.problems.get(reason, 0) + 1


@contextmanager
def open_node(network: RosNetwork, name: str) -> Iterator[RosNode]:
    """Opens a node for the duration of the block. The router need not be there yet.

    Raises:
        Gloc3Error: the configuration or the router's endpoint is wrong.
        Refused: the name is not allowed.
    """
    absolute(name)
    with _session(network) as session:
        node = RosNode(session, network, name)
        try:
            yield node
        finally:
            node.close()


def _session(network: RosNetwork) -> zenoh.Session:
    if "/" not in network.router:
        raise Gloc3Error(f"{network.router!r} is no Zenoh endpoint of a router; write it as {ROUTER}")
    try:
        if network.config is not None:
            config = zenoh.Config.from_file(str(network.config))
        else:
            config = zenoh.Config()
            for path, value in {
                "mode": "peer",
                "connect/endpoints": [network.router],
                "listen/endpoints": ["tcp/localhost:0"],
                "scouting/multicast/enabled": False,
                "scouting/gossip/enabled": True,
                "timestamping/enabled": True,
                "transport/shared_memory/enabled": False,
            }.items():
                config.insert_json5(path, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        place = network.config or network.router
        raise Gloc3Error(f"the network of ROS 2 cannot be opened at {place}: {str(error).split(' at /')[0]}") from error


def _utc_ns() -> int:
    return round(utc_now().timestamp() * 1e6) * 1000
