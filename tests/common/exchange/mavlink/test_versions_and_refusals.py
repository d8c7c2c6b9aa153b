"""What an end does not take is refused with a reason, shown and counted; never guessed."""

import asyncio
from collections.abc import Callable
from random import Random

import pytest
from tests.common.exchange.mavlink.ends import PLATFORM, Platform, Station, pair_on, standard_topics, text_of

from gloc3.clock import run_virtual
from gloc3.exchange.tunnel.layout import PAYLOAD_TYPE, VERSION, Lane
from gloc3.exchange.tunnel.routes import RELIABLE
from gloc3.exchange.tunnel.sending import MAX_BODY, MAX_WAITING
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address
from gloc3.messages import command_interface as ci
from gloc3.messages import summaries as ci_summaries
from gloc3.messages.command_interface import LoadMission, Steer, Verb
from gloc3.messages.envelope import Envelope, Message, Severity, Source
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.summaries import ComponentLine, Health, VehicleSummary
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.messages.wire import type_name

PAUSE = Steer(verb=Verb.PAUSE)


class CiRequest(Message, frozen=True):
    """As a later version might have it: with another fixed part."""

    sender: str
    boot: int
    sequence: int
    body: str
    priority: int


class ControlState(Message, frozen=True):
    """As another version has it."""

    holder: int


def other_topics() -> TopicTable:
    table = TopicTable()
    rows = dict(TOPICS)
    rows |= {name: TopicRow(CiRequest) for name, row in TOPICS.items() if row.message.__name__ == CiRequest.__name__}
    rows["ci/control"] = TopicRow(ControlState, 1.0, downlink_every=1)
    table.add(rows)
    return table


async def of_two_versions() -> tuple[Station, Platform]:
    station, platform, link = pair_on(1)
    station.close()
    station = Station(42, link.a, topics=other_topics())
    await asyncio.sleep(4.0)
    request = CiRequest(sender="255", boot=1, sequence=0, body="x", priority=3)
    station.publisher.publish(f"{PLATFORM}/ci/request", request, station.loop.time())
    platform.send_text("control", ci_summaries.ControlState(holder="255"))
    platform.report(2)
    await asyncio.sleep(6.0)
    return station, platform


def test_a_request_of_another_version_is_refused_and_shown_at_both_ends() -> None:
    station, platform = run_virtual(of_two_versions())
    assert not platform.given
    (undelivered,) = station.undelivered()
    assert undelivered.is_certain
    assert undelivered.reason.startswith("versions differ: CiRequest#")
    assert [text for text in platform.problems() if text.startswith("versions differ: CiRequest#")]
    assert platform.counters.versions_differ >= 1


def test_status_of_another_version_is_counted_and_the_rest_goes_on() -> None:
    station, _ = run_virtual(of_two_versions())
    assert not station.received(ci_summaries.ControlState)
    assert station.received(VehicleSummary)
    assert station.counters.versions_differ >= 1
    assert len([text for text in station.problems() if "ControlState" in text]) == 1


def test_another_version_of_the_tunnel_is_shown_once() -> None:
    async def fly() -> Platform:
        _, platform, _ = pair_on(2)
        for _ in range(3):
            payload = bytes((VERSION + 1,)) + b"whatever"
            tunnel = message("TUNNEL", payload_type=PAYLOAD_TYPE, payload_length=len(payload), payload=payload)
            platform.exchange.receive(tunnel, Address(254, 190))
        await asyncio.sleep(0.1)
        return platform

    platform = run_virtual(fly())
    assert platform.counters.other_version == 3
    assert platform.problems() == [f"versions differ: tunnel version {VERSION + 1} there, {VERSION} here"]


def test_a_station_can_not_publish_what_only_a_platform_says() -> None:
    async def fly() -> tuple[Station, Platform]:
        station, platform, _ = pair_on(3)
        await asyncio.sleep(4.0)
        # a station that was tampered with: it takes itself for a platform when it publishes
        forged = Envelope(
            f"{PLATFORM}/ci/event",
            Source(PLATFORM, "ci", 1),
            0,
            0.0,
            "",
            type_name(ci_summaries.CiEvent),
            ci_summaries.CiEvent(severity=Severity.INFO, source="x", text="x", t_s=0.0),
        )
        station.endpoint._submit(forged, station.loop.time())
        await asyncio.sleep(4.0)
        return station, platform

    station, platform = run_virtual(fly())
    (undelivered,) = station.undelivered()
    assert undelivered.reason == f"{PLATFORM}/ci/event is not accepted from a station"
    assert platform.counters.not_accepted >= 1


def ask_too_much(station: Station) -> None:
    station.request(LoadMission(name="m", text=text_of(MAX_BODY + 100, Random(1), is_random=True)))


def ask_too_often(station: Station) -> None:
    for _ in range(MAX_WAITING[Lane.ORDINARY] + 1):
        station.request(PAUSE)


@pytest.mark.parametrize(("ask", "reason"), [(ask_too_much, "too large"), (ask_too_often, "wait already")])
def test_too_much_at_once_is_refused_with_a_reason(ask: Callable[[Station], None], reason: str) -> None:
    async def fly() -> Station:
        station, _, _ = pair_on(4)
        await asyncio.sleep(4.0)
        ask(station)
        await asyncio.sleep(0.1)
        return station

    (undelivered,) = run_virtual(fly()).undelivered()
    assert undelivered.is_certain
    assert reason in undelivered.reason


def test_names_that_fit_no_frame_are_refused() -> None:
    async def fly() -> Station:
        station, _, _ = pair_on(5)
        station.request(PAUSE, platform="x" * 120)
        await asyncio.sleep(0.1)
        return station

    (undelivered,) = run_virtual(fly()).undelivered()
    assert "too long" in undelivered.reason


def test_status_that_is_too_long_is_counted_and_not_sent() -> None:
    async def fly() -> tuple[Station, Platform]:
        station, platform, _ = pair_on(6)
        await asyncio.sleep(4.0)
        random = Random(1)
        tasks = {text_of(20, random, is_random=True): "waiting" for _ in range(100)}
        platform.send_text("mission", ci_summaries.MissionSummary(name="m", digest="", state="running", tasks=tasks))
        await asyncio.sleep(4.0)
        return station, platform

    station, platform = run_virtual(fly())
    assert platform.counters.too_long == 1
    assert not station.received(ci_summaries.MissionSummary)


def test_topics_that_do_not_cross_the_link_stay_here() -> None:
    async def fly() -> tuple[Station, Platform]:
        station, platform, _ = pair_on(7)
        await asyncio.sleep(3.0)
        line = ComponentLine(0, 0, 0, 0, 0, 0)
        platform.send_text(
            "request", ci.CiRequest(sender="255", boot=1, sequence=0, body=PAUSE)
        )  # not in this direction
        platform.publisher.publish(
            "other/ci/summary", ci_summaries.Summary(table=1, health=Health.IDLE, lines=[line]), 0.0
        )
        await asyncio.sleep(3.0)
        return station, platform

    station, platform = run_virtual(fly())
    assert not [envelope for _, envelope in station.came if not isinstance(envelope.payload, ci.CiReply)]
    assert len(platform.given) == 1  # by its own subscribers


def test_every_reliable_topic_is_declared() -> None:
    assert all(standard_topics().row(f"{PLATFORM}/{name}") is not None for name in RELIABLE)
