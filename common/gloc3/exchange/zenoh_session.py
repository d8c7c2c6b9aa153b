"""Opens Zenoh sessions with explicit endpoints only: no scouting, and no implicit listeners.

A node without connect endpoints is a router. The nodes that connect to it alone are its clients, as child processes are
of their parent, and it forwards their messages to each other. A client may listen and have clients itself: so routers
form a tree of any depth, in which each has one uplink. A node with two uplinks would get messages twice.

A node that connects to several is a peer, in a region of its own below each. The cost of a declaration at a router grows
with its regions, its members and what they declare: with 200 regions a router needs minutes until everybody has joined,
with 200 clients a second.
"""

import json
from collections.abc import Callable, Mapping
from hashlib import blake2s
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Any, Final, NamedTuple

import msgspec
import zenoh
from msgspec.structs import replace

from gloc3.errors import Gloc3Error
from gloc3.exchange.front_door import TLS, FrontDoor, Refused
from gloc3.messages.topics import BULK_BYTES, ENVELOPE_BYTES

LEASE_S: Final = 2.0
"""Silence after which a node counts as lost, s."""
RETRY_S: Final = (0.2, 1.0)
"""How long a node waits before it tries again to reach another: at first, and at most."""
STALLED_S: Final = 5.0
"""Time after which a stalled link to a live peer is closed and reopened, s."""
QUEUES: Final = (
    "control",
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)
QUEUED_BATCHES: Final = 16
"""So many packets of at most 64 kB wait for a link, of each priority; Zenoh takes no more."""
UNIX: Final = "unixsock-stream"
QUIC: Final = "quic/"
BEGINNING: Final = "the beginning"
"""The node at which a client begins: no member's name."""
IN_USE: Final = "Address already in use"
RELEASED_S, TRY_S = 3.0, 0.05
"""Time for retries at opening, and between them, s: a closed session releases its QUIC port only after a few tenths
of a second, when it has said goodbye."""


class ZenohEndpoints(msgspec.Struct, frozen=True, kw_only=True):
    """A process on the network. Endpoints are Zenoh's: `tcp/HOST:PORT`, `tls/…`, `quic/…`, `unixsock-stream/PATH`."""

    name: str
    """Unique among those that connect to the same node."""
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    """Nodes that need not be there yet, or any more: they are tried again and again."""
    peers: tuple[str, ...] = ()
    """The names of the nodes that connect to this one and to others as well; clients and children need no name."""
    client_of: tuple[str, ...] = ()
    """The name of the one node at `connect`, whose client it is, or the names that it may have; empty for a peer of several."""
    is_child: bool = False
    """It connects to its parent process, which must be there."""


class NodeSession(NamedTuple):
    """A session, and the front door of its TLS addresses; None where it has none."""

    session: zenoh.Session
    door: FrontDoor | None
    beginning: TemporaryDirectory[str] | None = None
    """Where a client has begun (`_begin_client`)."""

    def accept(self, refused: Refused) -> None:
        """Has the front door accept connections.

        Args:
            refused: called in a thread about connections that were closed at once.
        """
        door = self.door
        if door is None:
            return

        def note(event: zenoh.LinkEvent) -> None:
            if event.kind == zenoh.SampleKind.PUT:
                door.note_link(str(event.link.dst))

        self.session.info.declare_link_events_listener(note, history=True)
        door.open(refused)

    def close(self) -> None:
        """Says goodbye, and frees the addresses."""
        self.session.close()  # type: ignore[no-untyped-call]
        if self.door is not None:
            self.door.close()
        if self.beginning is not None:
            self.beginning.cleanup()


def configuration(node: ZenohEndpoints, extra: Mapping[str, Any] | None = None) -> zenoh.Config:
    """Zenoh's configuration of a node.

    Args:
        node: the process.
        extra: more of Zenoh's settings, by their paths, such as `transport/link/tls/enable_mtls`.
    """
    regions = [{"region_names": [_region(name)]} for name in node.peers if name != node.name]
    values: dict[str, Any] = {
        "listen/endpoints": node.listen,
        "listen/exit_on_failure": True,
        "connect/endpoints": node.connect,
        "connect/retry": {
            "period_init_ms": round(RETRY_S[0] * 1e3),
            "period_max_ms": round(RETRY_S[1] * 1e3),
            "period_increase_factor": 2,
        },
        "scouting/multicast/enabled": False,
        "scouting/gossip/autoconnect": {"router": [], "peer": [], "client": []},
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,  # of its files some stay after SIGKILL; `near` has memory of ours
        "transport/link/rx/max_message_size": BULK_BYTES + ENVELOPE_BYTES,
        "transport/link/tx/lease": round(LEASE_S * 1e3),
        "transport/link/tx/queue/size": dict.fromkeys(QUEUES, QUEUED_BATCHES),
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": round(STALLED_S * 1e6),
    }
    values["mode"] = "client" if node.is_child or node.client_of else "peer" if node.connect else "router"
    if not node.is_child:
        above = {"region_names": [_region(name) for name in (*node.client_of, BEGINNING)], "negated": True}
        below = above if node.client_of else {"modes": ["client"]}
        values["gateway"] = {"south": [{"filters": [wanted]} for wanted in (*regions, below)]}
        values["region_name"] = _region(node.name)
    config = zenoh.Config()
    for path, value in {**values, **(extra or {})}.items():
        config.insert_json5(path, json.dumps(value))
    return config


def new_session(node: ZenohEndpoints, extra: Mapping[str, Any] | None = None) -> zenoh.Session:
    """Opens a session; the caller has to close it, since an interpreter with an open one never ends.

    Raises:
        Gloc3Error: an endpoint is in use or invalid, or a child's parent is not reachable.
    """
    for endpoint in node.listen:
        scheme, _, path = endpoint.partition("/")
        if scheme == UNIX:
            Path(path).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    pause, tries_left = Event(), round(RELEASED_S / TRY_S) if any(QUIC in endpoint for endpoint in node.listen) else 0
    while True:
        try:
            return zenoh.open(configuration(node, extra))
        except zenoh.ZError as error:
            if not tries_left or IN_USE not in str(error):
                places = ", ".join((*node.listen, *node.connect)) or "no endpoint"
                raise Gloc3Error(f"the network cannot be opened at {places}: {plain(error)}") from error
        tries_left -= 1
        pause.wait(TRY_S)


def open_node(node: ZenohEndpoints, extra: Mapping[str, Any] | None = None) -> NodeSession:
    """Opens a session, behind a front door where it listens over TLS; the caller has to close it.

    Raises:
        Gloc3Error: as for `new_session`.
    """
    announced = [endpoint for endpoint in node.listen if endpoint.startswith(TLS)]
    door = FrontDoor(announced) if announced else None
    if door is not None:
        others = [endpoint for endpoint in node.listen if endpoint not in announced]
        node = replace(node, listen=(door.endpoint, *others))
    try:
        if node.client_of:
            return _begin_client(node, extra, door)
        return NodeSession(new_session(node, extra), door)
    except BaseException:
        if door is not None:
            door.close()
        raise


def _begin_client(node: ZenohEndpoints, extra: Mapping[str, Any] | None, door: FrontDoor | None) -> NodeSession:
    """Opens a client whose router need not be there yet.

    Zenoh opens a client only when it is connected, but one that has lost its connection tries all its endpoints again and
    again. It therefore begins at a node of this process, which is closed at once. The folder of that socket stays, so that
    nobody else can listen in it.
    """
    folder = TemporaryDirectory(prefix="gloc3-")
    try:
        begin = ZenohEndpoints(name=BEGINNING, listen=(f"{UNIX}/{folder.name}/begin",))
        at_first = new_session(begin)
        try:
            session = new_session(replace(node, connect=(*begin.listen, *node.connect)), extra)
        finally:
            at_first.close()  # type: ignore[no-untyped-call]
    except BaseException:
        folder.cleanup()
        raise
    return NodeSession(session, door, folder)


def watch_links(session: zenoh.Session, changed: Callable[[str, bool], None]) -> None:
    """Reports the nodes that connect to a session, and leave.

    Args:
        session: an open session.
        changed: called in a thread of Zenoh's with the certificate's name, or else the address, of a node that has
            connected (True) or left (False).
    """

    def report(event: zenoh.LinkEvent) -> None:
        changed(event.link.auth_identifier or str(event.link.dst), event.kind == zenoh.SampleKind.PUT)

    session.info.declare_link_events_listener(report, history=True)


def plain(error: zenoh.ZError) -> str:
    """What Zenoh says went wrong, without the places in its source."""
    return str(error).split(" at /")[0].strip()


def _region(name: str) -> str:
    """A region's name takes at most 32 bytes."""
    return blake2s(name.encode(), digest_size=12).hexdigest()
