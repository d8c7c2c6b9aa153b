"""Routers in a tree: messages and rights pass two of them, a router forges nothing, and one that dies comes back."""

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from tests.common.exchange.middlewares import until
from tests.common.network.test_stations_on_the_network import START, Server, request
from tests.common.network.yard import LONG, NOW, Yard, free_port

from gloc3.component.lci import State
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.command_interface import CiReply, CiRequest, StationRole
from gloc3.messages.envelope import ComponentStatus, Envelope, Kind
from gloc3.messages.summaries import ControlState, Health, StationHeard, Summary
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import type_name
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.router import read_router, routing
from gloc3.network.stations import join_platforms

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]


def joined_yard(folder: Path) -> Yard:
    """A yard whose platform connects to the router root, and whose operator to the router coast below it."""
    yard = Yard(folder)
    for router in ("root", "coast"):
        add(yard, router, MemberRole.ROUTER, listen=[f"127.0.0.1:{free_port()}"])
    add(yard, "alice", MemberRole.OPERATOR, to=["coast"])
    return yard


def add(yard: Yard, name: str, role: MemberRole, **fields: Any) -> None:
    entry = register.NetworkMember(role=role, certificate="", until="", **fields)
    register.add(yard.folder, name, entry, NOW, LONG, is_renewed=True)


@contextmanager
def routed(yard: Yard, name: str) -> Iterator[None]:
    """A router on this loop."""
    with routing(read_router(yard.folder / name / "network.yaml"), lambda *_: None, lambda: None):
        yield


class Alice:
    """A station that asks again until it is answered."""

    def __init__(self, yard: Yard, network: Exchange) -> None:
        topics = TopicTable.installed()
        self.exchange = LocalExchange(topics)
        self.replies: list[CiReply] = []
        self.exchange.subscribe("pelican/ci/reply", lambda one: self.replies.append(one.payload))
        self.part = join_platforms(
            network, self.exchange, topics, "alice", signer=yard.membership("alice").signer(), unsent=pytest.fail
        )
        self._publisher, self._sequence = Publisher(self.exchange, "alice", "ci", 9), 0

    async def request(self, server: Server, within_s: float = 15.0) -> Envelope[CiRequest]:
        """The next request as it arrives at the vehicle."""
        loop, known = asyncio.get_running_loop(), len(server.used)
        end_s, good = loop.time() + within_s, list[Envelope[CiRequest]]()
        while loop.time() < end_s and not (good and self._has_reply(good[0])):
            server.summarise()
            self._sequence += 1
            body = replace(request("alice", self._sequence, START), until_s=loop.time() + 10.0)
            self._publisher.publish("pelican/ci/request", body, 0.0)
            await asyncio.sleep(0.05)
            good = [one for one in server.used[known:] if not one.payload.objection]
        return good[0]

    def _has_reply(self, requested: Envelope[CiRequest]) -> bool:
        return any(reply.sequence == requested.payload.sequence for reply in self.replies)


async def test_requests_reports_and_presence_pass_two_routers_and_a_dead_one_comes_back(tmp_path: Path) -> None:
    yard = joined_yard(tmp_path / "yard")
    with ExitStack() as stack:
        for name in ("root", "coast"):
            session = stack.enter_context(ExitStack())
            session.enter_context(routed(yard, name))
        main, vision = (stack.enter_context(yard.open(f"pelican.{host}")) for host in ("main", "vision"))
        network = stack.enter_context(yard.open("alice"))
        server, alice = Server(main, yard), Alice(yard, network)
        states: list[str] = []
        network.subscribe("pelican/components/*/status", lambda one: states.append(one.payload.name))
        found = (await alice.request(server)).payload
        assert (found.member, found.sender, found.role) == ("alice", "alice", StationRole.OPERATOR)
        assert server.bridge.forgeries == {}
        server.holds("alice")
        await asyncio.sleep(0.5)
        server.received.clear()
        await until(lambda: server.received.count("alice") >= 2)  # it signs its presence
        status, publisher = (
            ComponentStatus(name="camera", kind=Kind.SAMPLER, state=State.WORKING),
            Publisher(vision, "pelican", "camera", 1),
        )
        for _ in range(100):
            publisher.publish("pelican/components/camera/status", status, 0.0)
            await asyncio.sleep(0.05)
            if states:
                break
        assert states, "a platform's other hosts are heard, too"
        session.close()  # the coast's router is gone
        await asyncio.sleep(0.5)
        server.received.clear()
        await asyncio.sleep(1.5)
        assert server.received == [], "and so is the station, for the vehicle"
        stack.enter_context(routed(yard, "coast"))
        assert (await alice.request(server)).payload.member == "alice"
        alice.part()
        server.bridge.close()


async def test_a_router_can_forge_replay_and_pretend_nothing(tmp_path: Path) -> None:
    yard = joined_yard(tmp_path / "yard")
    with ExitStack() as stack:
        stack.enter_context(routed(yard, "root"))
        main, coast = stack.enter_context(yard.open("pelican.main")), stack.enter_context(yard.open("coast"))
        network = stack.enter_context(yard.open("alice"))
        server, alice = Server(main, yard), Alice(yard, network)
        kept: list[Envelope[Any]] = []
        coast.subscribe("pelican/ci/request/*", kept.append)
        await alice.request(server)
        await until(lambda: bool(kept))
        server.holds("alice")
        alice.part()  # she has left: from now on only the router speaks
        await asyncio.sleep(0.5)
        server.used.clear()
        server.received.clear()
        genuine = kept[-1]
        types, loop = TopicTable.installed().types, asyncio.get_running_loop()
        own = yard.membership("coast").signer()
        plain = replace(genuine, payload=request("alice", 900, START), type=type_name(CiRequest))
        numbers = iter(range(1_000_000, 2_000_000))

        def put(envelope: Envelope[Any]) -> None:
            coast.publish(replace(envelope, sequence=next(numbers)))

        held_back = replace(genuine, payload=replace(genuine.payload, until_s=loop.time() + 60.0))
        put(plain)
        put(own.sign(plain, types, until_s=loop.time() + 5.0, boot=77, utc_s=NOW.timestamp()))
        put(held_back)
        await until(lambda: server.bridge.forgeries.get("alice", 0) >= 3)
        assert server.used == []
        pretender = Publisher(coast, "pelican", "ci", 77)
        for _ in range(10):  # as if it were the vehicle's own command interface, or as if the station were still there
            pretender.publish("pelican/ci/control", ControlState(holder="nobody"), loop.time())
            pretender.publish("pelican/ci/summary", Summary(table=0, health=Health.WORKING, lines=[]), 0.0)
            pretender.publish("pelican/ci/heard", StationHeard(station="alice", member="alice"), 0.0)
            pretender.publish("pelican/ci/request", request("alice", 901, START), 0.0)
            await asyncio.sleep(0.15)
        coast.declare_alive("stations/alice")
        await asyncio.sleep(1.5)
        assert server.received == []
        assert server.used == []
        put(genuine)  # what it has carried already comes once more: the command interface knows it by its number
        await until(lambda: bool(server.used))
        assert server.used[-1].payload == replace(
            again_of(genuine, types), role=StationRole.OPERATOR, way="network", member="alice"
        )
        server.bridge.close()


def again_of(envelope: Envelope[Any], types: Any) -> CiRequest:
    """The request in a signed message."""
    found = types.decode(envelope.payload.data).payload
    assert isinstance(found, CiRequest)
    return found


def test_routers_form_a_tree(tmp_path: Path) -> None:
    yard = joined_yard(tmp_path / "yard")
    found = register.read_register(yard.folder)
    targets = {name: found.targets(name) for name in found.members}
    assert targets == {
        "pelican.main": ["root"],
        "pelican.vision": ["pelican.main"],
        "alice": ["coast"],
        "bob": ["root"],
        "root": [],
        "coast": ["root"],
    }
    for name, role, fields, why in (
        ("dora", MemberRole.OPERATOR, {"to": ["coast", "root"]}, "dora would get messages twice"),
        ("cove", MemberRole.ROUTER, {}, "a router needs an address"),
        ("cove", MemberRole.ROUTER, {"listen": ["10.0.0.1:7"], "to": ["pelican.main"]}, "connects to another router"),
        ("root", MemberRole.ROUTER, {"listen": ["10.0.0.1:7"], "to": ["coast"]}, "connected in a circle"),
    ):
        with pytest.raises(Refused, match=why):
            add(yard, name, role, **fields)
    with pytest.raises(Refused, match=r"it needs a router's"):
        read_router(yard.folder / "alice" / "network.yaml")
