"""Other people's ROS 2 without ROS: a router, definitions from rosbags, and nodes of ROBOTIS' zenoh-ros2-sdk."""

import json
import re
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2ServiceServer, ROS2Subscriber
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

    def message(self, kind: str, **fields: Any) -> Any:
        """A message of a type."""
        return ZenohSession.get_instance().register_message_type(None, kind)(**fields)

    def close(self) -> None:
        for one in self._open:
            one.close()


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


def until(condition: Callable[[], Any], within_s: float = 10.0) -> Any:
    """Waits in wall time; returns what the condition gives."""
    end_s = time.monotonic() + within_s
    while time.monotonic() < end_s:
        if found := condition():
            return found
        time.sleep(0.005)
    raise AssertionError("it has not come")
