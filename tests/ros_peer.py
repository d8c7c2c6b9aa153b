"""Other people's ROS 2 without ROS: a router, definitions from rosbags, and nodes of ROBOTIS' zenoh-ros2-sdk."""

import json
import re
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2ServiceServer, ROS2Subscriber
from zenoh_ros2_sdk.entity import NodeEntity
from zenoh_ros2_sdk.keyexpr import node_liveliness_keyexpr
from zenoh_ros2_sdk.message_registry import get_registry
from zenoh_ros2_sdk.session import ZenohSession

from gloc3_sitl.demo.demo import free_ports

STORE = get_typestore(Stores.ROS2_JAZZY)
NOTHING = "uint8 structure_needs_at_least_one_member"
"""An empty part of a service; the library takes none that is empty."""
TRIGGER = {"request_definition": NOTHING, "response_definition": "bool success\nstring message"}
GET_STATE = {"request_definition": NOTHING, "response_definition": "lifecycle_msgs/State current_state"}
CHANGE_STATE = {"request_definition": "lifecycle_msgs/Transition transition", "response_definition": "bool success"}


@contextmanager
def router() -> Iterator[str]:
    """A Zenoh router as rmw_zenohd is configured, on loopback; its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"
    config = zenoh.Config()
    for path, value in {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,
    }.items():
        config.insert_json5(path, json.dumps(value))
    with zenoh.open(config):
        yield endpoint


def write_definitions(folder: Path) -> None:
    """The `.msg` files of rosbags' definitions, where the library looks for them, so that it downloads none."""
    for name in STORE.types:
        package, kind, message = name.split("/")
        if kind != "msg":
            continue
        text = STORE.generate_msgdef(name)[0].partition("=" * 80)[0]
        text = re.sub(
            r"^(time|duration)\b", lambda found: f"builtin_interfaces/{found[0].title()}", text, flags=re.MULTILINE
        )
        path = folder / package / kind / f"{message}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


class Peer:
    """Nodes of the library at one router."""

    def __init__(self, endpoint: str) -> None:
        port = int(endpoint.rpartition(":")[2])
        self._place: dict[str, Any] = {"router_ip": "127.0.0.1", "router_port": port}
        self._open: list[Any] = []

    def subscribe(self, topic: str, kind: str) -> list[Any]:
        """Messages that come, in a list that grows."""
        found: list[Any] = []
        self._open.append(ROS2Subscriber(topic, kind, callback=found.append, **self._place))
        return found

    def publisher(self, topic: str, kind: str) -> Any:
        publisher = ROS2Publisher(topic, kind, **self._place)
        self._open.append(publisher)
        return publisher

    def call(self, service: str, kind: str, definitions: dict[str, str], **request: Any) -> Any:
        """Calls a service."""
        client = ROS2ServiceClient(service, kind, timeout=5.0, **definitions, **self._place)
        try:
            empty = {NOTHING.split()[1]: 0} if definitions["request_definition"] == NOTHING else {}
            return client.call(**empty, **request)
        finally:
            client.close()

    def serve(self, service: str, kind: str, definitions: dict[str, str], answer: Callable[[Any], Any]) -> Any:
        """Serves a service; `answer` gets the request, and returns fields of the response."""
        server: Any = None

        def handle(request: Any) -> Any:
            return server.response_msg_class(**answer(request))

        server = ROS2ServiceServer(service, kind, handle, **definitions, **self._place)
        self._open.append(server)
        return server

    def announce(self, name: str) -> Any:
        """The token of a node."""
        session = ZenohSession.get_instance()
        node = NodeEntity(0, session.session_id, session.get_next_node_id(), name.strip("/"), "/")
        return session.liveliness.declare_token(node_liveliness_keyexpr(node))

    def message(self, kind: str, **fields: Any) -> Any:
        """A message of a type."""
        return ZenohSession.get_instance().register_message_type(None, kind)(**fields)

    def close(self) -> None:
        for one in self._open:
            one.close()
        self._open.clear()


@contextmanager
def peer(endpoint: str, folder: Path) -> Iterator[Peer]:
    """Nodes at a router; `folder` is empty."""
    write_definitions(folder)
    session = ZenohSession.get_instance("127.0.0.1", int(endpoint.rpartition(":")[2]))
    registry = get_registry()
    registry.messages_dir = folder
    registry._loaded_types.clear()
    found = Peer(endpoint)
    try:
        yield found
    finally:
        found.close()
        ZenohSession._instance = None
        session.session.close()


class LifecycleNode:
    """A lifecycle node of ROS 2, as rclcpp's answers by its services.

    `fails` has the transitions that it fails at, which lead back to *unconfigured* through the error handler.
    """

    PRIMARY = MappingProxyType({1: "unconfigured", 2: "inactive", 3: "active", 4: "finalized"})
    ALLOWED = MappingProxyType({(1, 1): 2, (2, 2): 1, (2, 3): 3, (3, 4): 2})
    """State and transition to the next state."""

    def __init__(self, peer: Peer, name: str) -> None:
        self.state = 1
        self.requests: list[int] = []
        self.fails: set[int] = set()
        self._peer = peer
        self._token = peer.announce(name)
        for kind in ("Transition", "State"):
            peer.message(f"lifecycle_msgs/msg/{kind}", id=0, label="")  # the library has to know them first
        self._open = [
            peer.serve(f"{name}/change_state", "lifecycle_msgs/srv/ChangeState", CHANGE_STATE, self._change),
            peer.serve(f"{name}/get_state", "lifecycle_msgs/srv/GetState", GET_STATE, self._get),
        ]

    def put(self, state: int) -> None:
        """Somebody else, or an error, leads it into a state."""
        self.state = state

    def leave(self) -> None:
        """The node's process ends."""
        self._token.undeclare()

    def _message(self, state: int) -> Any:
        return self._peer.message(
            "lifecycle_msgs/msg/State", id=state, label=self.PRIMARY.get(state, "errorprocessing")
        )

    def _change(self, request: Any) -> dict[str, Any]:
        transition = request.transition.id
        self.requests.append(transition)
        to = self.ALLOWED.get((self.state, transition))
        if to is not None:
            self.put(1 if transition in self.fails else to)
        return {"success": to is not None and transition not in self.fails}

    def _get(self, request: Any) -> dict[str, Any]:
        return {"current_state": self._message(self.state)}


def until(condition: Callable[[], Any], within_s: float = 10.0) -> Any:
    """Waits in wall time; returns what the condition gives."""
    end_s = time.monotonic() + within_s
    while time.monotonic() < end_s:
        if found := condition():
            return found
        time.sleep(0.005)
    raise AssertionError("it has not come")
