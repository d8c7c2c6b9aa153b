"""The exchange around the tunnel: topics, tokens and clocks on both sides, and the bridge to other middlewares."""

import asyncio
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import (
    PLATFORM,
    PLATFORM_ADDRESS,
    RADIO_CONDITIONS,
    STATION_ADDRESS,
    Platform,
    Station,
    pair_on,
    standard_topics,
    text_of,
)

from gloc3.clock import run_virtual
from gloc3.errors import Misuse, Refused
from gloc3.exchange.base import LocalExchange, Publisher
from gloc3.exchange.mavlink import TunnelEndpoint
from gloc3.exchange.tunnel.frames import MAX_TOKENS
from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.mavlink.codec import message
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3.messages.command_interface import LoadMission, Steer, Verb
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import CiEvent, ControlState, Summary
from gloc3.messages.wire import type_name

CLEAN = replace(RADIO_CONDITIONS, loss=0.0)
CUT = replace(RADIO_CONDITIONS, loss=1.0)
PAUSE = Steer(verb=Verb.PAUSE)


def event(text: str) -> CiEvent:
    return CiEvent(severity=Severity.INFO, source="x", text=text, t_s=0.25)


def test_an_envelope_survives_the_link_as_it_was() -> None:
    async def fly() -> tuple[list[Envelope[Any]], list[Envelope[Any]]]:
        station, platform, _ = pair_on(1, CLEAN)
        sent: list[Envelope[Any]] = []
        for topic in ("event", "control", "summary"):
            platform.exchange.subscribe(f"{PLATFORM}/ci/{topic}", sent.append)
        await asyncio.sleep(3.0)
        platform.report(3)
        platform.publisher.publish(f"{PLATFORM}/ci/event", event("x"), 1.0 / 3.0, "hold")
        await asyncio.sleep(2.0)
        came = [
            envelope for _, envelope in station.came if isinstance(envelope.payload, CiEvent | ControlState | Summary)
        ]
        return sent, came

    sent, came = run_virtual(fly())
    assert len(came) >= 4
    assert all(envelope in sent for envelope in came)


def test_status_that_is_downlinked_every_second_time_is_thinned() -> None:
    async def fly() -> list[int]:
        link = MemoryLink(asyncio.get_running_loop(), Random(1), CLEAN)
        topics = standard_topics()
        row = topics.row(f"{PLATFORM}/ci/control")
        assert row is not None
        topics._rows["ci/control"] = replace(row, downlink_every=2)
        topics._found.clear()
        platform, station = Platform(1, link.b, topics=topics), Station(2, link.a)
        await asyncio.sleep(3.0)
        for n in range(8):
            platform.send_text("control", ControlState(holder=f"{n}"))
            await asyncio.sleep(0.5)
        return [int(state.holder) for state in station.received(ControlState)]

    assert [n for n in run_virtual(fly()) if n % 2] == []


def test_tokens_are_seen_at_the_other_end_until_they_are_withdrawn_or_the_link_is_gone() -> None:
    async def fly() -> list[tuple[str, bool]]:
        station, platform, link = pair_on(3)
        seen: list[tuple[str, bool]] = []
        station.exchange.watch("minoas/*", lambda token, is_alive: seen.append((token, is_alive)))
        withdraw = platform.exchange.declare_alive("minoas/ci")
        platform.exchange.declare_alive("minoas/ci")()  # a second one that ends changes nothing
        platform.exchange.declare_alive("minoas/host")
        await asyncio.sleep(6.0)
        withdraw()
        withdraw()
        await asyncio.sleep(6.0)
        link.set_conditions(CUT)
        await asyncio.sleep(12.0)
        link.set_conditions(RADIO_CONDITIONS)
        await asyncio.sleep(5.0)
        return seen

    ci, host = "minoas/ci", "minoas/host"
    assert run_virtual(fly()) == [(ci, True), (host, True), (ci, False), (host, False), (host, True)]


def test_too_many_tokens_are_refused() -> None:
    async def fly() -> None:
        station, _, _ = pair_on(4)
        for number in range(MAX_TOKENS):
            station.exchange.declare_alive(f"token{number}")
        with pytest.raises(Refused, match="alive already"):
            station.exchange.declare_alive("one more")

    run_virtual(fly())


def test_the_clocks_are_compared_by_greetings() -> None:
    async def fly() -> tuple[float | None, float | None, float | None]:
        station, platform, _ = pair_on(5)
        unknown = station.exchange.clock_offset_s(PLATFORM)
        await asyncio.sleep(10.0)
        return unknown, station.exchange.clock_offset_s(PLATFORM), platform.exchange.received_age_s("255")

    unknown, offset_s, age_s = run_virtual(fly())
    assert unknown is None
    assert offset_s == pytest.approx(0.0, abs=0.02)
    assert age_s is not None
    assert age_s < 3.0


def test_a_bridge_joins_the_components_of_both_sides_each_topic_in_its_direction() -> None:
    links_heard: list[str] = []

    async def fly() -> tuple[list[str], list[str]]:
        station, platform, _ = pair_on(6, CLEAN)
        onboard, ground = LocalExchange(), LocalExchange()
        topics = standard_topics()
        undo = platform.exchange.bridge(onboard, topics, PLATFORM)
        station.exchange.bridge(ground, topics)
        for link in (station.exchange, platform.exchange):
            link.subscribe("**", lambda envelope: links_heard.append(envelope.topic))
        platform.publisher = Publisher(onboard, PLATFORM, "ci", 1)
        onboard.subscribe(f"{PLATFORM}/ci/request", platform.serve)
        station.publisher = Publisher(ground, "255", "ci", 1)
        onboard_heard: list[str] = []
        ground_heard: list[str] = []
        onboard.subscribe("**", lambda envelope: onboard_heard.append(envelope.topic))
        ground.subscribe("**", lambda envelope: ground_heard.append(envelope.topic))
        await asyncio.sleep(3.0)
        station.request(PAUSE)
        await asyncio.sleep(2.0)
        onboard.publish(
            Envelope(f"{PLATFORM}/ci/event", platform.publisher.source, 0, 0.0, "", type_name(CiEvent), event("x"))
        )
        await asyncio.sleep(2.0)
        undo()
        onboard.publish(
            Envelope(f"{PLATFORM}/ci/event", platform.publisher.source, 1, 0.0, "", type_name(CiEvent), event("y"))
        )
        await asyncio.sleep(2.0)
        return onboard_heard, ground_heard

    onboard_heard, ground_heard = run_virtual(fly())
    assert onboard_heard == ["minoas/ci/request", "minoas/ci/reply", "minoas/ci/event", "minoas/ci/event"]
    assert ground_heard == ["minoas/ci/request", "minoas/ci/reply", "minoas/ci/event"]
    assert links_heard == [], "what crosses is published once on either side"


def test_an_error_of_a_subscriber_ends_neither_the_link_nor_what_else_came() -> None:
    class Broken(Exception): ...

    async def fly() -> list[str]:
        station, platform, _ = pair_on(7, CLEAN)

        def fail(envelope: Envelope[Any]) -> None:
            raise Broken

        received: list[str] = []
        station.exchange.subscribe("*/ci/reply", fail)
        station.exchange.subscribe("*/ci/event", lambda envelope: received.append(envelope.payload.text))
        await asyncio.sleep(3.0)
        station.request(PAUSE)
        platform.send_text("event", event("a"))
        await asyncio.sleep(2.0)
        platform.send_text("event", event("b"))
        await asyncio.sleep(2.0)
        heard_all.extend(received)
        return received

    heard_all: list[str] = []
    with pytest.raises(Broken):
        run_virtual(fly())
    assert heard_all == ["a", "b"]


def test_a_closed_exchange_sends_and_hears_nothing() -> None:
    async def fly() -> tuple[int, int]:
        station, platform, link = pair_on(8, CLEAN)
        await asyncio.sleep(3.0)
        station.exchange.close()
        sent = link.a.sent
        station.exchange.receive(message("HEARTBEAT"), PLATFORM_ADDRESS)
        platform.send_text("event", event("a"))
        await asyncio.sleep(3.0)
        assert not station.received(CiEvent)
        return sent, link.a.sent

    before, after = run_virtual(fly())
    assert before == after


def test_traffic_of_others_on_the_same_link_is_taken_into_account() -> None:
    async def upload_s(other_bytes_s: float) -> float:
        station, platform, _ = pair_on(9, CLEAN)
        await asyncio.sleep(4.0)
        station.request(LoadMission(name="m", text=text_of(5000, Random(1), is_random=True)))
        while not platform.given:
            await asyncio.sleep(0.1)
            station.endpoint.other_traffic(round(other_bytes_s * 0.1), station.loop.time())
        return platform.given[0][0] - 4.0

    assert run_virtual(upload_s(4000.0)) > 2.0 * run_virtual(upload_s(0.0))


@pytest.mark.parametrize("name", ["", "x" * 33])
def test_a_name_fits_the_greeting(name: str) -> None:
    with pytest.raises(Misuse):
        TunnelEndpoint(TunnelRole.STATION, name, STATION_ADDRESS, 1, standard_topics())
