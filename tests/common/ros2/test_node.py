"""A node of ours among nodes of another library on real Zenoh sessions."""

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Timer
from typing import Any

import pytest
from tests.ros_peer import TRIGGER, Peer, peer, router, until

from gloc3.errors import Gloc3Error, Refused
from gloc3.ros2.node import REASONS_KEPT, Received, RosClient, RosNetwork, RosNode, open_node
from gloc3.ros2.wire import LATCHED, STATE, Entity, EntityKind, Qos

pytestmark = pytest.mark.sockets


@pytest.fixture
def endpoint() -> Iterator[str]:
    with router() as endpoint:
        yield endpoint


@pytest.fixture
def node(endpoint: str) -> Iterator[RosNode]:
    with open_node(RosNetwork(router=endpoint), "/test/gloc3") as node:
        yield node


@pytest.fixture
def other(endpoint: str, tmp_path: Path) -> Iterator[Peer]:
    with peer(endpoint, tmp_path) as found:
        yield found


def test_others_receive_what_is_published(node: RosNode, other: Peer) -> None:
    publisher = node.publisher("/test/text", "std_msgs/String", STATE)
    received = other.subscribe("/test/text", "std_msgs/msg/String")

    def came() -> list[Any]:
        publisher.publish({"data": "höhe"})
        return received

    assert until(came)[0].data == "höhe"


def test_what_others_publish_is_received_with_its_attachment(node: RosNode, other: Peer) -> None:
    received: list[Received] = []
    node.subscribe("/test/vector", "geometry_msgs/Vector3", received.append, STATE)
    publisher = other.publisher("/test/vector", "geometry_msgs/msg/Vector3")

    def came() -> list[Received]:
        publisher.publish(x=1.0, y=2.0, z=3.0)
        return received

    first = until(came)[0]
    assert (first.message.x, first.message.y, first.message.z) == (1.0, 2.0, 3.0)
    assert first.head.gid == publisher.publisher_gid
    assert node.problems == {}


def test_services_are_called_in_both_directions(node: RosNode, other: Peer) -> None:
    node.serve("/test/ours", "std_srvs/Trigger", lambda _, respond: respond({"success": True, "message": "ours"}))
    answer = other.call("/test/ours", "std_srvs/srv/Trigger", TRIGGER)
    assert (answer.success, answer.message) == (True, "ours")
    other.serve("/test/theirs", "std_srvs/srv/Trigger", TRIGGER, lambda _: {"success": False, "message": "theirs"})
    client = node.client("/test/theirs", "std_srvs/Trigger")
    response = client.call({})
    assert (response.success, response.message) == (False, "theirs")


def test_a_request_that_reached_nobody_is_sent_again_until_the_server_is_there(
    node: RosNode, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a server's token arrives before its queryable."""
    monkeypatch.setattr(RosClient, "_await_server", lambda *_: None)
    with open_node(RosNetwork(router=endpoint), "/test/late") as late:
        requests = list[Any]()

        def answer(request: Any, respond: Callable[[Any], None]) -> None:
            requests.append(request)
            respond({"success": True, "message": "late"})

        timer = Timer(0.5, lambda: late.serve("/test/late", "std_srvs/Trigger", answer))
        timer.start()
        assert node.client("/test/late", "std_srvs/Trigger").call({}).message == "late"
        timer.join()
        assert len(requests) == 1


def test_a_service_that_nobody_serves_is_refused_in_time(node: RosNode) -> None:
    with pytest.raises(Refused, match="nobody serves /test/none, std_srvs::srv::dds_::Trigger_"):
        node.client("/test/none", "std_srvs/Trigger").call({}, within_s=0.3)


def test_the_graph_shows_who_comes_and_leaves(endpoint: str, node: RosNode) -> None:
    seen: list[tuple[EntityKind, str, str, bool]] = []

    def changed(entity: Entity, is_there: bool) -> None:
        if entity.node != "gloc3":
            seen.append((entity.kind, entity.node_name, entity.endpoint.name if entity.endpoint else "", is_there))

    node.watch(changed)
    with open_node(RosNetwork(router=endpoint), "/other") as second:
        second.publisher("/test/text", "std_msgs/String", STATE)
        until(lambda: len(seen) == 2)
        assert node.is_connected
    until(lambda: len(seen) == 4)
    entities = {(EntityKind.NODE, "/other", ""), (EntityKind.PUBLISHER, "/other", "/test/text")}
    assert {one[:3] for one in seen if one[3]} == {one[:3] for one in seen if not one[3]} == entities


def test_who_comes_late_gets_what_is_latched(endpoint: str, node: RosNode) -> None:
    publisher = node.publisher("/test/latched", "std_msgs/String", Qos(is_latched=True, depth=1))
    publisher.publish({"data": "first"})
    publisher.publish({"data": "last"})
    received: list[Received] = []
    with open_node(RosNetwork(router=endpoint), "/late") as late:
        late.subscribe("/test/latched", "std_msgs/String", received.append, LATCHED)
        until(lambda: received)
    assert [one.message.data for one in received] == ["last"]


def test_another_version_of_a_type_is_counted_not_decoded(node: RosNode, other: Peer) -> None:
    received: list[Received] = []
    node.subscribe("/test/text", "std_msgs/String", received.append, STATE)
    publisher = other.publisher("/test/text", "std_msgs/msg/String")
    publisher.pub = other._open[-1].session_mgr.session.declare_publisher(
        publisher.keyexpr.replace("RIHS01_df", "RIHS01_00")
    )

    def counted() -> dict[str, int]:
        publisher.publish(data="other")
        return node.problems

    assert "/test/text: another version of std_msgs/String, RIHS01_00668c740…" in until(counted)
    assert received == []


def test_reasons_are_not_kept_without_end(endpoint: str, node: RosNode) -> None:
    node.subscribe("/test/text", "std_msgs/String", lambda _: None, STATE)
    with open_node(RosNetwork(router=endpoint), "/other") as other:
        session = other._session

        def came() -> bool:
            for number in range(REASONS_KEPT + 8):
                session.put(f"0/test/text/std_msgs::msg::dds_::String_/RIHS01_{number}", b"")
            return "further messages are not accepted" in node.problems

        until(came)
    assert len(node.problems) == REASONS_KEPT + 1


def test_humble_has_no_hashes(endpoint: str, node: RosNode) -> None:
    received: list[Received] = []
    node.subscribe("/test/text", "std_msgs/String", received.append, STATE)
    with open_node(RosNetwork(router=endpoint, is_humble=True), "/humble") as humble:
        publisher = humble.publisher("/test/text", "std_msgs/String", STATE)

        def came() -> list[Received]:
            publisher.publish({"data": "humble"})
            return received

        assert until(came)[0].message.data == "humble"


def test_domains_do_not_hear_each_other(endpoint: str, node: RosNode) -> None:
    received: list[Received] = []
    node.subscribe("/test/text", "std_msgs/String", received.append, STATE)
    with open_node(RosNetwork(router=endpoint, domain=1), "/other") as other:
        elsewhere, here = other.publisher("/test/text", "std_msgs/String", STATE), node
        publisher = here.publisher("/test/text", "std_msgs/String", STATE)

        def came() -> list[Received]:
            elsewhere.publish({"data": "domain 1"})
            publisher.publish({"data": "domain 0"})
            return received

        until(came)
    assert {one.message.data for one in received} == {"domain 0"}


def test_without_a_router_a_node_opens_and_waits() -> None:
    with open_node(RosNetwork(router="tcp/127.0.0.1:1"), "/alone") as alone:
        assert not alone.is_connected


@pytest.mark.parametrize(
    ("endpoint", "reason"), [("nonsense", "'nonsense' is no Zenoh endpoint"), ("carrier/pigeon", "at carrier/pigeon: ")]
)
def test_a_wrong_endpoint_is_refused_with_its_text(endpoint: str, reason: str) -> None:
    with pytest.raises(Gloc3Error, match=reason), open_node(RosNetwork(router=endpoint), "/a"):
        pass
