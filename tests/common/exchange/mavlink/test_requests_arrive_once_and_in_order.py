"""Many requests of two stations, and events for both, over lossy links that duplicate and reorder."""

import asyncio
from itertools import pairwise
from random import Random

import pytest
from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import RADIO_CONDITIONS, Platform, Station, pair_on, text_of

from gloc3.clock import run_virtual
from gloc3.mavlink.message import Address
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3.messages.command_interface import (
    AnyBody,
    Emergency,
    EmergencyVerb,
    LoadMission,
    Query,
    ReadMission,
    RequestTask,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent

pytestmark = pytest.mark.thorough

ROUGH = replace(RADIO_CONDITIONS, duplicate=0.1, reorder=0.1, jitter_s=0.05)
PAUSE = Steer(verb=Verb.PAUSE)
START = Steer(verb=Verb.START)
HOLD = Emergency(verb=EmergencyVerb.HOLD)


def random_body(random: Random) -> AnyBody:
    kind = random.randrange(10)
    if kind == 0:
        return LoadMission(name="m", text=text_of(1500, random, is_random=True))
    if kind == 1:
        return HOLD
    return Query(boot=1, sequence=kind) if kind < 5 else Steer(verb=Verb.SKIP, target=f"task{kind}")


async def two_stations(seed: int) -> tuple[list[Station], Platform]:
    random = Random(seed)
    loop = asyncio.get_running_loop()
    links = [MemoryLink(loop, random, ROUGH), MemoryLink(loop, random, ROUGH)]
    stations = [
        Station(random.getrandbits(32), link.a, name=name, address=Address(int(name), 190))
        for link, name in zip(links, ("255", "254"), strict=True)
    ]
    platform = Platform(random.getrandbits(32), links[0].b, links[1].b)
    await asyncio.sleep(6.0)  # until everybody has heard everybody
    for number in range(20):
        await asyncio.sleep(random.expovariate(2.0))
        for station in stations:
            station.request(random_body(random))
        platform.send_text("event", CiEvent(severity=Severity.INFO, source="x", text=f"{number}", t_s=loop.time()))
    await asyncio.sleep(20.0)
    return stations, platform


def test_each_request_is_handed_over_once_and_each_event_reaches_each_station() -> None:
    stations, platform = run_virtual(two_stations(1))
    for station in stations:
        assert sorted(platform.sequences(station.name)) == list(range(20))
        assert sorted(station.acknowledged()) == list(range(20))
        assert sorted(station.replies) == list(range(20))
        assert [event.text for event in station.received(CiEvent)] == [f"{number}" for number in range(20)]
        assert not station.undelivered()
        kept = [
            request.sequence
            for _, request in platform.given
            if request.sender == station.name and not isinstance(request.body, LoadMission | Emergency)
        ]
        assert all(earlier < later for earlier, later in pairwise(kept))


async def order_of(*bodies: AnyBody) -> list[AnyBody]:
    station, platform, _ = pair_on(11)
    await asyncio.sleep(5.0)
    for body in bodies:
        station.request(body)
        await asyncio.sleep(0.5)
    await asyncio.sleep(25.0)
    return [request.body for _, request in platform.given]


UPLOAD = LoadMission(name="m", text=text_of(15_000, Random(1), is_random=True))


def test_short_requests_overtake_an_upload() -> None:
    assert run_virtual(order_of(UPLOAD, PAUSE)) == [PAUSE, UPLOAD]


def test_what_means_the_uploaded_mission_waits_for_it_and_what_follows_keeps_behind() -> None:
    bodies = run_virtual(order_of(UPLOAD, START, PAUSE, ReadMission()))
    assert bodies == [UPLOAD, START, PAUSE, ReadMission()]


def test_an_emergency_overtakes_an_upload_and_what_waits_behind_it() -> None:
    assert run_virtual(order_of(UPLOAD, START, PAUSE, HOLD)) == [HOLD, UPLOAD, START, PAUSE]


def test_an_emergency_overtakes_everything() -> None:
    """Also requests that wait in no queue behind an upload: enough of these to keep the link busy for seconds."""
    tasks: list[AnyBody] = [RequestTask(text=text_of(3_000, Random(number), is_random=True)) for number in range(4)]

    async def order() -> list[AnyBody]:
        station, platform, _ = pair_on(11)
        await asyncio.sleep(5.0)
        for body in [UPLOAD, *tasks]:
            station.request(body)
        await asyncio.sleep(0.2)
        station.request(HOLD)
        await asyncio.sleep(25.0)
        return [request.body for _, request in platform.given]

    assert run_virtual(order()) == [HOLD, *tasks, UPLOAD]


def test_an_emergency_arrives_within_2_s_during_an_upload() -> None:
    async def delay_s(seed: int) -> float:
        station, platform, _ = pair_on(seed)
        await asyncio.sleep(5.0)
        station.request(UPLOAD)
        await asyncio.sleep(1.0)
        sent_s = station.loop.time()
        station.request(HOLD)
        await asyncio.sleep(4.0)
        return next(t_s for t_s, request in platform.given if request.body == HOLD) - sent_s

    assert max(run_virtual(delay_s(seed)) for seed in range(6)) < 2.0


def test_a_request_that_is_asked_for_again_while_it_is_under_way_is_not_sent_again() -> None:
    async def ask_twice() -> tuple[Station, Platform]:
        station, platform, _ = pair_on(3)
        await asyncio.sleep(5.0)
        station.request(UPLOAD)
        await asyncio.sleep(1.0)
        station.requested = 0
        station.request(UPLOAD)
        await asyncio.sleep(15.0)
        return station, platform

    station, platform = run_virtual(ask_twice())
    assert platform.sequences() == [0]
    assert station.counters.repeated_requests == 1


def test_a_request_to_a_platform_that_was_not_heard_yet_waits_for_it() -> None:
    async def ask_early() -> Platform:
        station, platform, _ = pair_on(4)
        station.request(PAUSE)
        await asyncio.sleep(6.0)
        return platform

    assert run_virtual(ask_early()).sequences() == [0]


def test_a_request_to_a_platform_that_is_never_heard_comes_back() -> None:
    async def ask_nobody() -> Station:
        station, _, _ = pair_on(5)
        station.request(PAUSE, platform="nautilus")
        await asyncio.sleep(20.0)
        return station

    (undelivered,) = run_virtual(ask_nobody()).undelivered()
    assert undelivered.is_certain
    assert "nautilus" in undelivered.reason


def test_one_station_commands_several_platforms() -> None:
    async def ask_both() -> list[Platform]:
        loop, random = asyncio.get_running_loop(), Random(9)
        links = [MemoryLink(loop, random, ROUGH), MemoryLink(loop, random, ROUGH)]
        station = Station(1, links[0].a, links[1].a)
        names = [("minoas", Address(1, 191)), ("nautilus", Address(2, 191))]
        platforms = [
            Platform(n, link.b, name=name, address=address)
            for n, (link, (name, address)) in enumerate(zip(links, names, strict=True))
        ]
        await asyncio.sleep(5.0)
        for name, _ in names:
            station.request(PAUSE, platform=name)
        await asyncio.sleep(5.0)
        assert len(station.replies) == 2
        return platforms

    assert [platform.sequences() for platform in run_virtual(ask_both())] == [[0], [1]]
