"""The station over MAVLink: a mission is streamed through a memory link, and exactly one heartbeat leaves."""

import asyncio
from collections.abc import Awaitable, Callable
from random import Random
from typing import NamedTuple, TypeVar

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform

from gloc3.clock import Clock, run_virtual
from gloc3.exchange import LocalExchange
from gloc3.exchange.mavlink import MavlinkExchange, TunnelEndpoint, TunnelRole
from gloc3.exchange.tunnel.pacing import budget_of
from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.signing import TICKS_PER_S, Signing, is_signed_with, timestamp
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.command_interface import Outcome, Steer, Verb
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.desk import flights
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_groundstation.links.links import Links
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.station import Station

T = TypeVar("T")
TOPICS = TopicTable.installed()
PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n" + "# a line of a mission\n" * 40)


class Scene(NamedTuple):
    station: Station
    platform: ScriptedPlatform
    link: StationLinkCore
    received: list[Frame]
    """What the platform's end of the link has heard."""
    inject: Callable[[bytes], None]
    """Puts bytes on the link from the platform's side."""
    reported: list[str]
    memory: MemoryLink


def over(conditions: Conditions, play: Callable[[Scene], Awaitable[T]]) -> T:
    async def main() -> T:
        loop = asyncio.get_running_loop()
        memory = MemoryLink(loop, Random(3), conditions)
        here, there = LocalExchange(), LocalExchange()
        received: list[Frame] = []
        reported: list[str] = []
        platform = ScriptedPlatform(there)
        encoder, parser = Encoder(1, 191), Parser(is_datagram=True)
        end = TunnelEndpoint(TunnelRole.PLATFORM, platform.name, Address(1, 191), 99, TOPICS)
        tunnel = MavlinkExchange(end, loop, lambda sent: memory.b.send(encoder.encode(sent)))
        tunnel.bridge(there, TOPICS, platform.name)

        def handle(data: bytes) -> None:
            for frame in parser.receive(data):
                received.append(frame)
                decoded = frame.decode()
                assert decoded is not None
                tunnel.receive(decoded, frame.sender)

        memory.b.on_data = handle
        station = Station(here, loop, "255", 11)
        link = StationLinkCore(
            memory.a.send,
            LinkContext(
                loop=loop,
                exchange=here,
                topics=TOPICS,
                boot=11,
                undelivered=station.client.undelivered,
                report=reported.append,
            ),
        )
        memory.a.on_data = link.receive
        platform.loop.call_later(0.3, platform.speak_every, 0.5)
        try:
            return await play(Scene(station, platform, link, received, memory.b.send, reported, memory))
        finally:
            station.close()
            link.close()
            tunnel.close()

    return run_virtual(main())


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_mission_is_streamed_and_started_over_mavlink(loss: float) -> None:
    async def play(scene: Scene) -> None:
        name = await flights.await_platform(scene.station, None)
        await flights.stream(scene.station, name, PLAN)
        await flights.start(scene.station, name)
        assert scene.platform.text == PLAN.text
        known = scene.station.fleet.get(name)
        assert known is not None
        assert len(known.components(scene.station.now_s())) == 13
        assert scene.reported == []

    over(Conditions(loss=loss, latency_s=0.15, bandwidth_bit_s=57_600, bits_per_byte=10), play)


def test_one_heartbeat_a_second_leaves_as_that_of_a_ground_station() -> None:
    async def play(scene: Scene) -> None:
        ended: asyncio.Future[None] = scene.platform.loop.create_future()
        scene.platform.loop.call_later(10.05, ended.set_result, None)
        await ended
        beats = [frame for frame in scene.received if frame.message_id == 0]
        assert len(beats) == 11
        (beat,) = {(b.type, b.autopilot) for frame in beats if (b := frame.decode()) is not None}
        assert beat == (6, 8)
        assert {frame.sender for frame in scene.received} == {Address(255, 190)}

    over(Conditions(), play)


def test_who_is_heard_is_told_and_a_second_station_of_the_same_id_too() -> None:
    async def play(scene: Scene) -> None:
        scene.inject(Encoder(1, 1).encode(message("HEARTBEAT", type=2, autopilot=12)))
        scene.inject(b"\xfd garbage \xfe\xfd")
        await flights.await_platform(scene.station, None)
        assert scene.link.received() == ["autopilot 1/1"]
        other = Encoder(255, 190)
        for _ in range(100):
            other.encode(message("HEARTBEAT", type=6, autopilot=8))
        for _ in range(4):
            assert scene.reported == []
            scene.inject(other.encode(message("HEARTBEAT", type=6, autopilot=8)))
            await asyncio.sleep(1.0)
        assert scene.reported == ["another station is 255, too; see --station-id"]

    over(Conditions(), play)


def test_our_own_frames_that_a_router_brings_back_are_no_other_station() -> None:
    async def play(scene: Scene) -> None:
        ended: asyncio.Future[None] = scene.platform.loop.create_future()
        scene.platform.loop.call_later(5.0, ended.set_result, None)
        await ended
        beats = [frame.raw for frame in scene.received if frame.message_id == 0]
        for raw in beats[-2:]:
            scene.inject(raw)
        await asyncio.sleep(0.5)
        assert scene.reported == []
        for raw in beats:  # all at once, from a router that has stalled
            scene.inject(raw)
        await asyncio.sleep(3.0)
        assert scene.reported == []


def test_a_burst_of_our_frames_of_long_ago_is_no_other_station() -> None:
    async def play(scene: Scene) -> None:
        await asyncio.sleep(5.0)
        beats = [frame.raw for frame in scene.received if frame.message_id == 0]
        await asyncio.sleep(60.0)
        for raw in beats:
            scene.inject(raw)
            await asyncio.sleep(0.2)
        await asyncio.sleep(5.0)
        assert scene.reported == []

    over(Conditions(), play)


def test_a_serial_line_is_used_at_its_rate() -> None:
    assert budget_of("serial:///dev/ttyUSB0:115200").rate_bit_s == 115_200
    assert budget_of("udpin://0.0.0.0:14550").rate_bit_s > 1e6


@pytest.mark.sockets
async def test_links_are_opened_described_and_closed_and_one_to_a_network_without_a_key_is_told() -> None:
    loop, told = asyncio.get_running_loop(), list[str]()
    links = Links(LinkContext(loop=loop, exchange=LocalExchange(), topics=TOPICS, boot=1, report=told.append))
    try:
        await links.add("udpin://127.0.0.1:0")
        assert (links.describe(), told) == ("udpin://127.0.0.1:0", [])
        await links.add("udpin://0.0.0.0:0")
        (only,) = told
        assert only.startswith(
            "udpin://0.0.0.0:0 is open to the network and not signed: anyone who reaches it can command the vehicle"
        )
    finally:
        await links.close()


def test_the_round_trip_to_a_platform_is_known_from_greetings() -> None:
    async def play(scene: Scene) -> None:
        await flights.await_platform(scene.station, None)
        assert scene.link.round_trip_s("nobody") is None
        passed: asyncio.Future[None] = scene.platform.loop.create_future()
        scene.platform.loop.call_later(10.0, passed.set_result, None)
        await passed
        assert scene.link.round_trip_s("heron") == pytest.approx(0.6, abs=0.15)

    over(Conditions(latency_s=0.3), play)


def test_a_request_that_the_link_could_not_deliver_is_refused_with_the_reason_and_not_called_unknown() -> None:
    async def play(scene: Scene) -> None:
        await flights.await_platform(scene.station, None)
        reply = await scene.station.client.request("nobody_here", Steer(verb=Verb.PAUSE))
        assert reply.outcome is Outcome.REFUSED
        assert reply.reason == "not delivered: no known peer receives nobody_here/ci/request"

    over(Conditions(), play)


def test_a_request_that_may_have_been_delivered_when_the_link_broke_stays_unknown() -> None:
    async def play(scene: Scene) -> None:
        name = await flights.await_platform(scene.station, None)
        scene.memory.set_conditions(Conditions(loss=1.0))
        reply = await scene.station.client.request(name, Steer(verb=Verb.PAUSE))
        assert reply.outcome is Outcome.UNKNOWN
        assert reply.reason.startswith("it may have been delivered (no answer from heron)")

    over(Conditions(), play)


def test_on_a_signed_link_other_frames_are_dropped_counted_and_told_once_a_minute() -> None:
    key = bytes(range(32))

    async def play() -> None:
        loop = asyncio.get_running_loop()
        memory, reported = MemoryLink(loop, Random(3)), list[str]()
        link = StationLinkCore(
            memory.a.send,
            LinkContext(loop=loop, exchange=LocalExchange(), topics=TOPICS, boot=11, report=reported.append),
            LinkSettings(key=key),
        )
        memory.a.on_data = link.receive
        received: list[Frame] = []
        memory.b.on_data = lambda data: received.extend(Parser(is_datagram=True).receive(data))
        beat = message("HEARTBEAT", type=2, autopilot=12)
        now = timestamp(Clock(loop).utc_offset_s)
        signing = Signing(key, link_id=1, now=now)
        genuine, forged = Encoder(1, 1, signing), Encoder(2, 1, Signing(bytes(32), link_id=1, now=100))

        def send_genuine(number: int) -> None:
            signing.advance(now + number * TICKS_PER_S)
            memory.b.send(genuine.encode(beat))

        for number in range(70):
            loop.call_later(number, lambda: memory.b.send(forged.encode(beat)))
            loop.call_later(number, lambda: memory.b.send(Encoder(3, 1).encode(beat)))
            loop.call_later(number, send_genuine, number)
        ended: asyncio.Future[None] = loop.create_future()
        loop.call_later(70.0, ended.set_result, None)
        await ended
        assert link.received() == ["autopilot 1/1"]
        assert link.refused == 140
        assert reported == [
            "a frame from 2/1 is dropped (the signature is wrong), and so will others be; has it another key?",
            "a frame from 3/1 is dropped (not signed), and so will others be; is signing switched on there?",
            "a frame from 2/1 is dropped (the signature is wrong), 61 so far; has it another key?",
            "a frame from 3/1 is dropped (not signed), 61 so far; is signing switched on there?",
        ]
        assert received
        assert all(is_signed_with(key, frame) for frame in received)
        link.close()

    run_virtual(play())
