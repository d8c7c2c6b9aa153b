"""Sessions with explicit endpoints: clients of a node that need not be there yet, in a tree, and what a router knows of them."""

import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from gloc3.exchange.zenoh_session import UNIX, NodeSession, ZenohEndpoints, configuration, open_node

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]


def until(is_true: Callable[[], bool], within_s: float = 20.0) -> None:
    end_s = time.monotonic() + within_s
    while not is_true():
        assert time.monotonic() < end_s, "not within the time"
        time.sleep(0.02)


class Tree:
    """A root, a router of each side below it, and a leaf below each; each can come and go."""

    def __init__(self, folder: Path) -> None:
        places = {name: f"{UNIX}/{folder}/{name}" for name in ("root", "left", "right")}
        self._nodes = {
            "root": ZenohEndpoints(name="root", listen=(places["root"],)),
            "left": ZenohEndpoints(
                name="left", listen=(places["left"],), connect=(places["root"],), client_of=("root",)
            ),
            "right": ZenohEndpoints(
                name="right", listen=(places["right"],), connect=(places["root"],), client_of=("root",)
            ),
            "a": ZenohEndpoints(name="a", connect=(places["left"],), client_of=("left",)),
            "b": ZenohEndpoints(name="b", connect=(places["right"],), client_of=("right",)),
        }
        self.open: dict[str, NodeSession] = {}

    def begin(self, name: str) -> NodeSession:
        self.open[name] = open_node(self._nodes[name])
        return self.open[name]

    def end(self, name: str) -> None:
        self.open.pop(name).close()

    def close(self) -> None:
        for name in list(self.open):
            self.end(name)


def test_clients_join_whenever_their_routers_come_and_again_when_they_come_back(tmp_path: Path) -> None:
    tree, received, alive = Tree(tmp_path), list[str](), list[bool]()
    with ExitStack() as stack:
        stack.callback(tree.close)
        for name in ("a", "b"):
            tree.begin(name)  # before there is anybody else
        session, other = tree.open["a"].session, tree.open["b"].session
        publisher, _token = session.declare_publisher("a/b"), session.liveliness().declare_token("a/alive")
        _heard = other.declare_subscriber("a/*", lambda sample: received.append(sample.payload.to_string()))
        _watch = other.liveliness().declare_subscriber(
            "a/alive", lambda sample: alive.append("PUT" in str(sample.kind)), history=True
        )

        def hears(text: str) -> bool:
            publisher.put(text)
            return text in received

        for name in ("right", "left", "root"):
            tree.begin(name)
        until(lambda: hears("first") and alive == [True])
        for gone in ("root", "left"):
            tree.end(gone)
            until(lambda: not alive[-1])
            assert not hears(f"without {gone}")
            tree.begin(gone)
            until(lambda gone=gone: hears(f"{gone} again") and alive[-1])  # type: ignore[misc]
        assert f"without {gone}" not in received


def test_a_router_has_regions_only_for_members_that_connect_to_others_too() -> None:
    def regions(node: ZenohEndpoints) -> list[object]:
        return list(json.loads(configuration(node).get_json("gateway"))["south"])

    place = "tcp/127.0.0.1:1"
    assert len(regions(ZenohEndpoints(name="root", listen=(place,)))) == 1
    assert len(regions(ZenohEndpoints(name="root", listen=(place,), peers=("one", "two")))) == 3
    leaf = ZenohEndpoints(name="leaf", connect=(place,), client_of=("root",))
    assert json.loads(configuration(leaf).get_json("mode")) == "client"
    assert json.loads(configuration(ZenohEndpoints(name="leaf", connect=(place,))).get_json("mode")) == "peer"


def test_the_place_where_a_client_begins_is_its_own_and_goes_with_it(tmp_path: Path) -> None:
    node = open_node(ZenohEndpoints(name="a", connect=(f"{UNIX}/{tmp_path}/nobody",), client_of=("nobody",)))
    assert node.beginning is not None
    folder = Path(node.beginning.name)
    assert folder.stat().st_mode & 0o077 == 0
    assert not (folder / "begin").exists()
    node.close()
    assert not folder.exists()
