"""Stations' requests over the network: signed by their members, and what is not what it says is counted and told."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from tests.common.exchange.middlewares import until
from tests.common.network.yard import LONG, NOW, Yard, members_of

from gloc3.clock import Clock
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.command_interface import (
    AnyBody,
    CiReply,
    CiRequest,
    Emergency,
    EmergencyVerb,
    Hello,
    Outcome,
    StationRole,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Envelope, Message, Severity, SignedMessage, Source
from gloc3.messages.summaries import CiEvent, ControlState, Health, StationHeard, Summary
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import type_name
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.signatures import RequestSigner
from gloc3.network.stations import join_platforms

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
START = Steer(verb=Verb.START)
SERVER = 77
"""Boot of the command interface server."""


class Server:
    """A command interface server as plain as it can be: it accepts everything that reaches it."""

    def __init__(self, exchange: Any, yard: Yard) -> None:
        self.used: list[Envelope[CiRequest]] = []
        self.received: list[str] = []
        self.reported: list[tuple[str, str]] = []
        self._publisher = Publisher(exchange, "pelican", "ci", SERVER)
        exchange.subscribe("pelican/ci/request", self._take)
        exchange.subscribe("pelican/ci/heard", lambda e: self.received.append(e.payload.station))
        self.bridge = yard.bridge(exchange, lambda *reported: self.reported.append(reported))
        self.summarise()

    def summarise(self) -> None:
        summary = Summary(table=0, health=Health.WORKING, lines=[])
        self._publisher.publish("pelican/ci/summary", summary, asyncio.get_running_loop().time())

    def holds(self, station: str) -> None:
        self._publisher.publish("pelican/ci/control", ControlState(holder=station), 0.0)

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        self.used.append(envelope)
        request = envelope.payload
        reply = CiReply(sender=request.sender, boot=request.boot, sequence=request.sequence, outcome=Outcome.ACCEPTED)
        self._publisher.publish("pelican/ci/reply", reply, 0.0)


def request(sender: str, sequence: int, body: AnyBody) -> CiRequest:
    return CiRequest(sender=sender, boot=9, sequence=sequence, body=body)


class Stranger:
    """Puts whatever it likes on the keys of a platform, signed by members whose keys it has."""

    def __init__(self, exchange: LocalExchange, yard: Yard) -> None:
        self.signers = {name: yard.membership(name).signer() for name in ("alice", "bob", "pelican.main")}
        self._exchange, self._types, self._loop = exchange, TopicTable.installed().types, asyncio.get_running_loop()

    def envelope(self, key: str, message: Message) -> Envelope[Any]:
        source = Source("somewhere", "ci", 9)
        return Envelope(f"pelican/ci/{key}", source, 0, 0.0, "", type_name(type(message)), message)

    def signed(self, key: str, message: Message, signer: RequestSigner, **fields: Any) -> Envelope[SignedMessage]:
        values = {"until_s": self._loop.time() + 5.0, "boot": SERVER, "utc_s": NOW.timestamp(), **fields}
        return signer.sign(self.envelope(key, message), self._types, **values)

    def send(self, key: str, message: Message, by: str = "", **fields: Any) -> None:
        signer = self.signers[by or key.partition("/")[2]]
        self._exchange.publish(self.signed(key, message, signer, **fields))

    def put(self, envelope: Envelope[Any]) -> None:
        self._exchange.publish(envelope)


async def test_a_station_asks_commands_and_is_answered_under_its_own_name(tmp_path: Path) -> None:
    yard, topics = Yard(tmp_path / "yard"), TopicTable.installed()
    with yard.open("pelican.main") as main, yard.open("alice") as network:
        server = Server(main, yard)
        alice = LocalExchange(topics)
        replies: list[CiReply] = []
        alice.subscribe("pelican/ci/reply", lambda e: replies.append(e.payload))
        part = join_platforms(
            network, alice, topics, "alice", signer=yard.membership("alice").signer(), unsent=pytest.fail
        )
        publisher = Publisher(alice, "alice", "ci", 9)
        until_s = asyncio.get_running_loop().time() + 30.0
        for sequence in range(1000):
            server.summarise()
            start = replace(request("alice", 2 * sequence + 1, START), until_s=until_s)
            publisher.publish("pelican/ci/request", request("alice", 2 * sequence, Hello()), 0.0)
            publisher.publish("pelican/ci/request", start, 0.0)
            await asyncio.sleep(0.03)
            if {reply.sequence % 2 for reply in replies} == {0, 1}:
                break
        assert {reply.outcome for reply in replies} == {Outcome.ACCEPTED}
        assert {envelope.topic for envelope in server.used} == {"pelican/ci/request"}
        assert {envelope.payload.member for envelope in server.used} == {"alice"}
        assert server.bridge.forgeries == {}
        await until(lambda: server.received.count("alice") >= 3)
        server.holds("alice")
        received = len(server.received)
        await until(lambda: len(server.received) >= received + 3)
        part()
        await asyncio.sleep(0.3)
        received = len(server.received)
        await asyncio.sleep(1.2)
        assert len(server.received) == received
        server.bridge.close()


async def test_requests_that_are_not_what_they_say_are_counted_told_and_not_carried_out(tmp_path: Path) -> None:
    exchange, yard = LocalExchange(), Yard(tmp_path / "yard")
    server, stranger = Server(exchange, yard), Stranger(exchange, yard)
    event = CiEvent(severity=Severity.INFO, source="x", text="x", t_s=0.0)
    stranger.send("request/alice", request("bob", 0, START))
    stranger.send("ask/bob", request("bob", 1, START))
    stranger.send("request/pelican.main", request("pelican.main", 4, START))
    stranger.put(stranger.envelope("request/mallory", request("mallory", 3, START)))
    assert server.reported == [
        ("alice", "it says that it is of 'bob'"),
        ("bob", "Steer came as a question"),
        ("pelican.main", "pelican.main is not a station of this network"),
        ("mallory", "mallory is not a station of this network"),
    ]
    stranger.send("request/alice", request("alice", 2, Hello()))
    stranger.send("ask/alice", event)
    assert server.bridge.forgeries == {"alice": 3, "bob": 1, "mallory": 1, "pelican.main": 1}
    assert not server.used
    for number in range(95):
        stranger.put(stranger.envelope("request/mallory", request("mallory", number, START)))
    told = [reason for station, reason in server.reported if station == "mallory"]
    assert told == ["mallory is not a station of this network", "mallory is not a station of this network (10 so far)"]
    pretended = replace(request("bob", 5, START), role=StationRole.OPERATOR, way="serial:///dev/ttyS0", member="alice")
    stranger.send("request/bob", pretended)
    stranger.send("request/alice", request("alice", 6, START))
    assert [(one.payload.sequence, one.payload.role, one.payload.way, one.payload.member) for one in server.used] == [
        (5, StationRole.OBSERVER, "network", "bob"),  # the server refuses it
        (6, StationRole.OPERATOR, "network", "alice"),
    ]
    server.bridge.close()


async def test_whoever_forwards_a_request_can_forge_change_redirect_and_delay_nothing(tmp_path: Path) -> None:
    exchange, yard = LocalExchange(), Yard(tmp_path / "yard")
    server, stranger = Server(exchange, yard), Stranger(exchange, yard)
    other = Yard(tmp_path / "other")
    alice, start = stranger.signers["alice"], request("alice", 0, START)
    good = stranger.signed("request/alice", start, alice)
    data = good.payload.data.replace(b"start", b"abort")
    assert data != good.payload.data
    forged: dict[str, tuple[Envelope[Any], str]] = {
        "not signed": (
            stranger.envelope("request/alice", start),
            "CiRequest is not a signed message: give the station the vehicle's version",
        ),
        "another member's key": (
            stranger.signed("request/alice", start, stranger.signers["bob"]),
            "it is signed by bob/",
        ),
        "another authority's key": (
            stranger.signed("request/alice", start, other.membership("alice").signer()),
            "its certificate is not of this network's authority",
        ),
        "changed": (replace(good, payload=replace(good.payload, data=data)), "its signature is wrong"),
        "prolonged": (replace(good, payload=replace(good.payload, until_s=1e9)), "its signature is wrong"),
        "another vehicle's": (
            replace(stranger.signed("request/alice", start, alice), payload=_for("hummingbird", stranger, alice)),
            "its signature is wrong: it was changed on the way, or is for another vehicle",
        ),
        "damaged": (replace(good, payload=replace(good.payload, certificate=b"x")), "its certificate is not of"),
    }
    for what, (envelope, reason) in forged.items():
        server.bridge.forgeries.clear()
        stranger.put(envelope)
        assert server.reported[-1][1].startswith(reason), what
    assert len(server.reported) == len(forged)
    assert not server.used
    now_s = asyncio.get_running_loop().time()
    for fields, objection in (
        ({"until_s": now_s - 1.5}, "it came 1.5 s after its time limit"),
        ({"until_s": 0.0}, "it has no time limit"),
        ({"boot": SERVER - 1}, "it is for an earlier start of the vehicle's command interface"),
        ({}, ""),
    ):
        stranger.send("request/alice", start, **fields)
        assert server.used[-1].payload.objection.startswith(objection)
    assert server.used[-1].payload.objection == ""
    stranger.send("ask/alice", request("alice", 1, Hello()), until_s=0.0, boot=0)
    assert server.used[-1].payload.objection == ""
    server.bridge.close()


async def test_nobody_but_the_holder_of_control_keeps_up_its_contact(tmp_path: Path) -> None:
    exchange, yard = LocalExchange(), Yard(tmp_path / "yard")
    server, stranger = Server(exchange, yard), Stranger(exchange, yard)
    exchange.declare_alive("stations/alice")
    await until(lambda: len(server.received) >= 2)
    server.holds("alice")
    server.received.clear()
    here, now_s = StationHeard(station="alice"), asyncio.get_running_loop().time()
    for fields in ({"until_s": now_s - 0.1}, {"until_s": 0.0}, {"boot": SERVER - 1}, {"until_s": float("nan")}):
        stranger.send("ask/alice", here, **fields)
    stranger.send("ask/alice", here, "bob")
    await asyncio.sleep(1.2)  # its token is still there
    assert server.received == []
    stranger.send("ask/alice", here)
    assert server.received == ["alice"]
    server.bridge.close()


async def test_a_wrong_clock_of_the_station_stops_no_emergency_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Clock, "is_utc_right", lambda _: True)
    exchange, yard = LocalExchange(), Yard(tmp_path / "yard")
    server, stranger = Server(exchange, yard), Stranger(exchange, yard)
    yesterday_s = NOW.timestamp() - 86_400.0
    bodies: tuple[tuple[AnyBody, bool], ...] = (
        (START, True),
        (Emergency(verb=EmergencyVerb.HOLD), False),
        (Emergency(verb=EmergencyVerb.LAND), True),
    )
    for sequence, (body, is_refused) in enumerate(bodies):
        stranger.send("request/alice", request("alice", sequence, body), utc_s=yesterday_s)
        assert ("set the station's clock" in server.used[-1].payload.objection) is is_refused, body
    server.bridge.close()


def _for(platform: str, stranger: Stranger, signer: RequestSigner) -> SignedMessage:
    """A request to another platform, as it was signed."""
    envelope = replace(
        stranger.envelope("request/alice", request("alice", 0, START)), topic=f"{platform}/ci/request/alice"
    )
    types, until_s = TopicTable.installed().types, asyncio.get_running_loop().time() + 5.0
    return signer.sign(envelope, types, until_s=until_s, boot=SERVER, utc_s=NOW.timestamp()).payload


async def test_a_renewed_or_revoked_members_former_key_signs_nothing_any_more(tmp_path: Path) -> None:
    exchange, yard = LocalExchange(), Yard(tmp_path / "yard")
    server, former = Server(exchange, yard), Stranger(exchange, yard)
    yard.add("alice", MemberRole.OPERATOR, LONG, is_renewed=True)
    server.bridge.members = members_of(yard.membership("pelican.main"))
    former.send("request/alice", request("alice", 0, START))
    assert server.reported[-1][1].startswith("it is signed by alice/")
    Stranger(exchange, yard).send("request/alice", request("alice", 1, START))
    assert [one.payload.sequence for one in server.used] == [1]
    register.revoke(yard.folder, "alice", NOW)
    server.bridge.members = members_of(yard.membership("pelican.main"))
    server.bridge.forgeries.clear()
    former.send("request/alice", request("alice", 2, START))
    assert server.reported[-1][1] == "alice is not a station of this network"
    assert len(server.used) == 1
    server.bridge.close()


async def test_velocities_that_are_asked_for_by_hand_come_under_the_name_of_an_operator_or_not_at_all(
    tmp_path: Path,
) -> None:
    yard, topics = Yard(tmp_path / "yard"), TopicTable.installed()
    used: list[Envelope[VelocityDemand]] = []
    with yard.open("pelican.main") as main, yard.open("alice") as network:
        server = Server(main, yard)
        main.subscribe("pelican/velocity_demand", used.append)
        alice = LocalExchange(topics)
        part = join_platforms(
            network, alice, topics, "alice", signer=yard.membership("alice").signer(), unsent=pytest.fail
        )
        publisher = Publisher(alice, "alice", "ci", 9)
        for sequence in range(1000):
            server.summarise()
            demand = VelocityDemand(sender="alice", session=1, sequence=sequence, velocity_cm_s=(40, 0, 0))
            publisher.publish("pelican/velocity_demand", demand, 1.25)
            await asyncio.sleep(0.03)
            if used:
                break
        assert (used[0].payload.role, used[0].payload.way, used[0].t_s) == (StationRole.OPERATOR, "network", 1.25)
        server.bridge.close()
        part()
    exchange = LocalExchange()
    server, stranger = Server(exchange, yard), Stranger(exchange, yard)
    exchange.subscribe("pelican/velocity_demand", used.append)
    count = len(used)
    for by, sender, fields in (("bob", "bob", {}), ("alice", "bob", {}), ("alice", "alice", {"boot": 1})):
        server.bridge.forgeries.clear()
        demand = VelocityDemand(sender=sender, session=1, sequence=0)
        signer: RequestSigner = stranger.signers[by]
        envelope = replace(stranger.envelope(f"demand/{by}", demand), topic=f"pelican/demand/{by}")
        values: dict[str, Any] = {"until_s": 1e9, "boot": SERVER, "utc_s": NOW.timestamp(), **fields}
        sign: Callable[..., Envelope[SignedMessage]] = signer.sign
        exchange.publish(sign(envelope, TopicTable.installed().types, **values))
    assert len(used) == count
    assert [reason for _, reason in server.reported] == [
        "an observer may not command",
        "it says that it is of 'bob'",
        "it is for an earlier start of the vehicle's command interface; send it again if it is still wanted",
    ]
    server.bridge.close()
