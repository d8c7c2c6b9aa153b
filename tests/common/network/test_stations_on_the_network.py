"""Stations' requests over the network: the key proves the author, and what is not what it says is counted and told."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from tests.common.exchange.middlewares import until
from tests.common.network.yard import Yard

from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.command_interface import AnyBody, CiReply, CiRequest, Hello, Outcome, StationRole, Steer, Verb
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import CiEvent
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.topics import TopicTable
from gloc3.network.access import MemberRole
from gloc3.network.stations import StationBridge, join_platforms

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
START = Steer(verb=Verb.START)
ROLES = {"alice": MemberRole.OPERATOR, "bob": MemberRole.OBSERVER, "pelican.main": MemberRole.PLATFORM}


class Server:
    """A command interface server as plain as it can be: it accepts everything that reaches it."""

    def __init__(self, exchange: Any, roles: dict[str, MemberRole]) -> None:
        loop = asyncio.get_running_loop()
        self.used: list[Envelope[CiRequest]] = []
        self.received: list[str] = []
        self.reported: list[tuple[str, str]] = []
        self._publisher = Publisher(exchange, "pelican", "ci", 1)
        exchange.subscribe("pelican/ci/request", self._take)
        exchange.subscribe("pelican/ci/heard", lambda e: self.received.append(e.payload.station))
        self.bridge = StationBridge(
            exchange, loop, "pelican", roles, 2, lambda *reported: self.reported.append(reported)
        )

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        self.used.append(envelope)
        request = envelope.payload
        reply = CiReply(sender=request.sender, boot=request.boot, sequence=request.sequence, outcome=Outcome.ACCEPTED)
        self._publisher.publish("pelican/ci/reply", reply, 0.0)


def request(sender: str, sequence: int, body: AnyBody) -> CiRequest:
    return CiRequest(sender=sender, boot=9, sequence=sequence, body=body)


async def test_a_station_asks_commands_and_is_answered_under_its_own_name(tmp_path: Path) -> None:
    yard, topics = Yard(tmp_path / "yard"), TopicTable.installed()
    membership = yard.membership("pelican.main")
    with yard.open("pelican.main") as main, yard.open("alice") as network:
        server = Server(main, dict(membership.file.roles))
        alice = LocalExchange(topics)
        replies: list[CiReply] = []
        alice.subscribe("pelican/ci/reply", lambda e: replies.append(e.payload))
        part = join_platforms(network, alice, topics, "alice")
        publisher = Publisher(alice, "alice", "ci", 9)
        for sequence in range(1000):
            publisher.publish("pelican/ci/request", request("alice", 2 * sequence, Hello()), 0.0)
            publisher.publish("pelican/ci/request", request("alice", 2 * sequence + 1, START), 0.0)
            await asyncio.sleep(0.03)
            if {reply.sequence % 2 for reply in replies} == {0, 1}:
                break
        assert {reply.outcome for reply in replies} == {Outcome.ACCEPTED}
        assert {envelope.topic for envelope in server.used} == {"pelican/ci/request"}
        assert server.bridge.forgeries == {}
        await until(lambda: server.received.count("alice") >= 3)
        part()
        await asyncio.sleep(0.3)
        received = len(server.received)
        await asyncio.sleep(1.2)
        assert len(server.received) == received
        server.bridge.close()


async def test_requests_that_are_not_what_they_say_are_counted_told_and_not_carried_out() -> None:
    exchange = LocalExchange()
    server = Server(exchange, ROLES)
    stranger = Publisher(exchange, "somewhere", "ci", 9)
    event = CiEvent(severity=Severity.INFO, source="x", text="x", t_s=0.0)
    sent = [
        ("request/alice", request("bob", 0, START), "it says that it is of 'bob'"),
        ("ask/bob", request("bob", 1, START), "Steer came as a question"),
        ("request/alice", request("alice", 2, Hello()), "Hello came as a command"),
        ("request/mallory", request("mallory", 3, START), "mallory is not a station of this network"),
        ("request/pelican.main", request("pelican.main", 4, START), "pelican.main is not a station of this network"),
        ("ask/alice", event, "CiEvent is not a request"),
    ]
    for key, message, _ in sent:
        stranger.publish(f"pelican/ci/{key}", message, 0.0)
    assert server.reported == [
        (key.partition("/")[2], reason) for number, (key, _, reason) in enumerate(sent) if number not in (2, 5)
    ]
    assert server.bridge.forgeries == {"alice": 3, "bob": 1, "mallory": 1, "pelican.main": 1}
    assert not server.used
    for number in range(95):
        stranger.publish("pelican/ci/request/mallory", request("mallory", number, START), 0.0)
    told = [reason for station, reason in server.reported if station == "mallory"]
    assert told == ["mallory is not a station of this network", "mallory is not a station of this network (10 so far)"]
    pretended = replace(request("bob", 5, START), role=StationRole.OPERATOR, way="serial:///dev/ttyS0")
    stranger.publish("pelican/ci/request/bob", pretended, 0.0)
    stranger.publish("pelican/ci/request/alice", request("alice", 6, START), 0.0)
    assert [(each.payload.sequence, each.payload.role, each.payload.way) for each in server.used] == [
        (5, StationRole.OBSERVER, "network"),  # the server refuses it
        (6, StationRole.OPERATOR, "network"),
    ]
    server.bridge.close()


async def test_velocities_that_are_asked_for_by_hand_come_under_the_name_of_an_operator_or_not_at_all(
    tmp_path: Path,
) -> None:
    yard, topics = Yard(tmp_path / "yard"), TopicTable.installed()
    used: list[Envelope[VelocityDemand]] = []
    with yard.open("pelican.main") as main, yard.open("alice") as network:
        server = Server(main, ROLES)
        main.subscribe("pelican/velocity_demand", used.append)
        alice = LocalExchange(topics)
        part = join_platforms(network, alice, topics, "alice")
        publisher = Publisher(alice, "alice", "ci", 9)
        for sequence in range(1000):
            demand = VelocityDemand(sender="alice", session=1, sequence=sequence, velocity_cm_s=(40, 0, 0))
            publisher.publish("pelican/velocity_demand", demand, 1.25)
            await asyncio.sleep(0.03)
            if used:
                break
        assert (used[0].payload.role, used[0].payload.way, used[0].t_s) == (StationRole.OPERATOR, "network", 1.25)
        count = len(used)
        stranger = Publisher(main, "somewhere", "ci", 9)
        for key, sender in (("bob", "bob"), ("alice", "bob"), ("mallory", "mallory")):
            stranger.publish(f"pelican/demand/{key}", VelocityDemand(sender=sender, session=1, sequence=0), 0.0)
        await asyncio.sleep(0.1)
        assert len(used) == count
        assert [reason for _, reason in server.reported] == [
            "an observer may not command",
            "it says that it is of 'bob'",
            "mallory is not a station of this network",
        ]
        part()
        server.bridge.close()
