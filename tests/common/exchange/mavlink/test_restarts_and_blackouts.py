"""Processes that restart and links that break in the middle of a transfer."""

import asyncio
from random import Random

import pytest
from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import RADIO_CONDITIONS, Platform, Station, pair_on, text_of

from gloc3.clock import run_virtual
from gloc3.exchange.tunnel.events import PeerChanged
from gloc3.exchange.tunnel.peers import DROP_AFTER_S
from gloc3.exchange.tunnel.routes import EMERGENCY_PATIENCE_S, REQUEST_TIMEOUT_S
from gloc3.mavlink.message import Address
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3.messages.command_interface import Emergency, EmergencyVerb, LoadMission, Steer, Verb

pytestmark = pytest.mark.thorough

CUT = replace(RADIO_CONDITIONS, loss=1.0)
CLEAN = replace(RADIO_CONDITIONS, loss=0.0)
UPLOAD = LoadMission(name="m", text=text_of(15_000, Random(1), is_random=True))
PAUSE = Steer(verb=Verb.PAUSE)


def test_an_upload_goes_on_after_a_blackout_of_30_s() -> None:
    async def fly() -> tuple[Station, Platform, float]:
        station, platform, link = pair_on(1)
        platform.report(20)
        await asyncio.sleep(5.0)
        station.request(UPLOAD)
        await asyncio.sleep(2.0)
        link.set_conditions(CUT)
        await asyncio.sleep(30.0)
        link.set_conditions(RADIO_CONDITIONS)
        back_s = station.loop.time()
        await asyncio.sleep(15.0)
        return station, platform, back_s

    station, platform, back_s = run_virtual(fly())
    ((given_s, request),) = platform.given
    assert request.body == UPLOAD
    assert given_s - back_s < 9.0
    assert station.acknowledged() == [0]
    assert not station.undelivered()
    alive = [happening.is_alive for happening in station.events if isinstance(happening, PeerChanged)]
    assert alive == [True, False, True]


def test_requests_of_a_long_blackout_come_back_and_are_not_carried_out_afterwards() -> None:
    async def fly() -> tuple[Station, Platform]:
        station, platform, link = pair_on(2)
        await asyncio.sleep(5.0)
        link.set_conditions(CUT)
        station.request(PAUSE)
        station.request(Emergency(verb=EmergencyVerb.HOLD))
        await asyncio.sleep(30.0)
        link.set_conditions(RADIO_CONDITIONS)
        await asyncio.sleep(5.0)
        station.request(PAUSE)
        await asyncio.sleep(5.0)
        return station, platform

    station, platform = run_virtual(fly())
    assert platform.sequences() == [2]
    undelivered = station.undelivered()
    assert [given_up.envelope.payload.sequence for given_up in undelivered] == [1, 0]
    assert not any(given_up.is_certain for given_up in undelivered)  # they were sent: nobody can know
    assert EMERGENCY_PATIENCE_S < REQUEST_TIMEOUT_S < 30.0


def test_an_upload_begins_anew_when_the_platform_restarts_in_the_middle() -> None:
    async def fly() -> tuple[Station, Platform, Platform]:
        station, platform, link = pair_on(3)
        await asyncio.sleep(5.0)
        station.request(UPLOAD)
        await asyncio.sleep(2.0)
        platform.close()
        successor = Platform(99, link.b)
        await asyncio.sleep(15.0)
        return station, platform, successor

    station, platform, successor = run_virtual(fly())
    assert not platform.given
    assert [request.body for _, request in successor.given] == [UPLOAD]
    assert station.acknowledged() == [0]


def test_what_may_have_been_handed_over_before_a_restart_is_unknown_and_not_handed_over_again() -> None:
    async def fly() -> tuple[Station, Platform, Platform]:
        station, platform, link = pair_on(4, CLEAN)
        await asyncio.sleep(5.0)
        link.b.conditions = CUT  # neither acknowledgement nor reply gets out
        station.request(PAUSE)
        await asyncio.sleep(0.5)
        platform.close()
        successor = Platform(99, link.b)
        link.b.conditions = CLEAN
        await asyncio.sleep(10.0)
        return station, platform, successor

    station, platform, successor = run_virtual(fly())
    assert platform.sequences() == [0]
    assert not successor.given
    (undelivered,) = station.undelivered()
    assert not undelivered.is_certain
    assert "restarted" in undelivered.reason
    assert not station.acknowledged()


def test_a_station_that_restarts_in_the_middle_of_an_upload_can_upload_again() -> None:
    async def fly() -> tuple[Platform, Station]:
        station, platform, link = pair_on(5)
        await asyncio.sleep(5.0)
        station.request(LoadMission(name="old", text=UPLOAD.text))
        await asyncio.sleep(2.0)
        station.close()
        successor = Station(77, link.a)
        await asyncio.sleep(3.0)
        successor.request(UPLOAD)
        await asyncio.sleep(15.0)
        return platform, successor

    platform, successor = run_virtual(fly())
    assert [request.body for _, request in platform.given] == [UPLOAD]
    assert 0 in successor.replies
    restarted = [happening for happening in platform.events if isinstance(happening, PeerChanged)]
    assert [happening.is_restarted for happening in restarted] == [False, True]


@pytest.mark.parametrize("silent", ["station", "platform"])
def test_after_a_long_silence_of_one_end_alone_requests_and_replies_go_on_at_once(silent: str) -> None:
    async def fly() -> tuple[Station, Platform]:
        station, platform, link = pair_on(8, CLEAN)
        await asyncio.sleep(3.0)
        for _ in range(100):
            station.request(PAUSE)
            await asyncio.sleep(0.5)
        await asyncio.sleep(2.0)
        (link.a if silent == "station" else link.b).conditions = CUT
        await asyncio.sleep(DROP_AFTER_S + 10.0)
        assert [len(end.endpoint.peers()) for end in (station, platform)].count(0) == 1, "one end has dropped the other"
        link.set_conditions(CLEAN)
        await asyncio.sleep(5.0)
        station.replies.clear()
        for _ in range(40):
            station.request(PAUSE)
            await asyncio.sleep(1.0)
        return station, platform

    station, platform = run_virtual(fly())
    assert list(station.replies) == list(range(100, 140))
    assert platform.sequences() == list(range(140))
    assert not platform.undelivered()
    assert not station.undelivered()


def join(first: Station, link: MemoryLink) -> None:
    """A second program takes the station's address, and both hear what comes."""
    second = Station(77, link.a)

    def handle(data: bytes) -> None:
        first.take(data)
        second.take(data)

    link.a.on_data = handle


def test_two_processes_at_one_address_are_shown_as_a_clash() -> None:
    async def fly() -> Platform:
        first, platform, link = pair_on(6, CLEAN)
        await asyncio.sleep(5.0)
        join(first, link)
        await asyncio.sleep(8.0)
        return platform

    assert run_virtual(fly()).problems() == ["two processes use the address 255/190"]


def test_a_second_program_that_has_ended_keeps_the_station_away_for_seconds_only() -> None:
    async def fly() -> tuple[Station, Platform, float]:
        station, platform, link = pair_on(9, CLEAN)
        await asyncio.sleep(5.0)
        station.request(UPLOAD)
        link.b.conditions = CUT  # no acknowledgement gets out
        station.request(PAUSE)
        await asyncio.sleep(1.0)
        link.b.conditions = CLEAN
        second = Station(77, link.a)
        await asyncio.sleep(0.2)
        second.close()
        link.a.on_data = station.take
        ended_s = station.loop.time()
        station.request(Emergency(verb=EmergencyVerb.HOLD))
        await asyncio.sleep(30.0)
        return station, platform, ended_s

    station, platform, ended_s = run_virtual(fly())
    handed_over = {type(request.body): at_s for at_s, request in platform.given}
    assert len(platform.given) == len(handed_over) == 3, "each once, also what had been handed over before"
    assert 0.0 < handed_over[Emergency] - ended_s < EMERGENCY_PATIENCE_S, "while the emergency still waits"
    assert sorted(station.acknowledged()) == [0, 1, 2]
    assert not station.undelivered()
    assert platform.problems() == ["two processes use the address 255/190"]


def test_of_two_programs_at_one_address_the_first_is_not_accepted_while_the_second_lives() -> None:
    async def fly() -> Platform:
        first, platform, link = pair_on(10)
        await asyncio.sleep(5.0)
        join(first, link)
        await asyncio.sleep(60.0)
        return platform

    changed = [happening for happening in run_virtual(fly()).events if isinstance(happening, PeerChanged)]
    assert [happening.is_restarted for happening in changed] == [False, True]


def test_two_stations_of_one_name_are_shown_as_a_clash() -> None:
    async def fly() -> Platform:
        _, platform, link = pair_on(7, CLEAN)
        Station(77, link.a, name="255", address=Address(254, 190))
        await asyncio.sleep(3.0)
        return platform

    assert run_virtual(fly()).problems() == ["two stations call themselves 255"]


async def a_minute_of_restarts(seed: int) -> None:
    random = Random(seed)
    station, platform, link = pair_on(seed)
    given: list[tuple[int, int]] = []
    acknowledged: list[tuple[int, int]] = []

    def bury(end: Station | Platform) -> None:
        end.close()
        if isinstance(end, Platform):
            given.extend((request.boot, request.sequence) for _, request in end.given)
        else:
            acknowledged.extend((end.boot, sequence) for sequence in end.acknowledged())

    for boot in range(1, 9):
        for _ in range(5):
            await asyncio.sleep(random.uniform(0.1, 1.0))
            station.request(PAUSE)
        await asyncio.sleep(random.uniform(0.0, 3.0))
        if boot % 2:
            bury(platform)
            platform = Platform(boot, link.b)
        else:
            bury(station)
            station = Station(boot, link.a)
    await asyncio.sleep(20.0)
    bury(station)
    bury(platform)
    assert len(set(given)) == len(given)
    assert set(acknowledged) <= set(given)
    assert len(given) > 20


def test_a_whole_minute_with_restarts_of_both_ends_hands_nothing_over_twice() -> None:
    for seed in range(3):
        run_virtual(a_minute_of_restarts(seed))


def test_patience_is_counted_from_when_a_request_was_made_also_while_nobody_is_heard() -> None:
    async def fly() -> tuple[Station, Platform]:
        station, platform, link = pair_on(2)
        link.set_conditions(CUT)
        station.request(PAUSE)
        station.request(Emergency(verb=EmergencyVerb.HOLD))
        await asyncio.sleep(EMERGENCY_PATIENCE_S + 1.0)
        assert [given_up.is_certain for given_up in station.undelivered()] == [True]
        link.set_conditions(CLEAN)
        await asyncio.sleep(9.0)
        return station, platform

    _, platform = run_virtual(fly())
    assert [type(request.body) for _, request in platform.given] == [Steer]
