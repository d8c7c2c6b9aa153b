"""Pictures and samples over a 57,600 baud link in virtual time: status, commands and missions go first."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from random import Random
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import PLATFORM, RADIO_CONDITIONS, Platform, Station, pair_on, text_of

from gloc3.clock import run_virtual
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget
from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.command_interface import LoadMission, Steer, Verb
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.summaries import Summary
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Pose
from gloc3.messages.watch import Preview, Sample, pack, unpack

pytestmark = pytest.mark.thorough

CLEAN = replace(RADIO_CONDITIONS, loss=0.0)
USUAL_PICTURE = 1200
WORST_PICTURE = 1700
"""Bytes of 64 × 48 grey values of pure noise, compressed."""


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    previews_s: list[float]
    """When each came."""
    late_s: list[float]
    """How old each was then."""
    samples: int
    slowest_status_hz: float
    view_bytes_s: float
    sent_bytes_s: float


class Looked:
    """A platform whose camera and pose somebody looks at."""

    def __init__(self, platform: Platform, seed: int, stations: tuple[str, ...] = ("255",)) -> None:
        self.platform = platform
        self.random = Random(seed)
        self.stations = stations
        self.is_on = True

    def show(self, rate_hz: float = 1.0, large: bool = True, size: int = WORST_PICTURE) -> None:
        """Shows a picture (or a pose) now and then."""
        if not self.is_on:
            return
        loop, platform = self.platform.loop, self.platform
        payload: Any = POSE
        topic, name = "watch/sample/pose", "pose"
        if large:
            data = self.random.randbytes(size)
            payload = Preview(camera="front", width=64, height=48, full_width=640, full_height=480, data=data)
            topic, name = "watch/large/camera/front", "camera/front"
        envelope: Envelope[Any] = Envelope(f"{PLATFORM}/{name}", Source(PLATFORM, name, 1), 0, 0.0, "", "", payload)
        sample = pack(envelope, payload, rate_hz, self.stations)
        platform.publisher.publish(f"{PLATFORM}/{topic}", sample, loop.time())
        loop.call_later(1.0 / rate_hz, self.show, rate_hz, large, size)


POSE = Pose(position_ned_m=(1.0, 2.0, 3.0), velocity_ned_m_s=(0.1, 0.2, 0.3), ned_from_frd=(1.0, 0.0, 0.0, 0.0))


def poll(
    seed: int,
    conditions: Conditions,
    duration_s: float = 30.0,
    *,
    is_half_duplex: bool = False,
    size: int = WORST_PICTURE,
    budget: LinkBudget = RADIO,
) -> Seen:
    """Looks at a picture once a second and at ten poses a second, beside the status of 20 components."""
    return run_virtual(_look(seed, conditions, duration_s, is_half_duplex, size, budget))


async def _look(
    seed: int, conditions: Conditions, duration_s: float, is_half_duplex: bool, size: int, budget: LinkBudget
) -> Seen:
    station, platform, _ = pair_on(seed, conditions, is_half_duplex=is_half_duplex, budget=budget)
    came = watched(station)
    platform.report(20)
    await asyncio.sleep(3.0)
    checked = Looked(platform, seed)
    checked.show(1.0, True, size)
    checked.show(10.0, False)
    await asyncio.sleep(duration_s)
    now_s = station.loop.time()
    counters = platform.counters
    rows = [line.index for _, e in station.came if isinstance(e.payload, Summary) for line in e.payload.lines]
    large = [(t_s, e) for t_s, e in came if e.topic.startswith(f"{PLATFORM}/watch/large/")]
    station.close()
    platform.close()
    return Seen(
        previews_s=[t_s for t_s, _ in large],
        late_s=[t_s - e.t_s for t_s, e in large],
        samples=len(came) - len(large),
        slowest_status_hz=min(rows.count(index) for index in range(20)) / now_s,
        view_bytes_s=counters.view_bytes / duration_s,
        sent_bytes_s=counters.sent_bytes / now_s,
    )


def watched(station: Station) -> list[tuple[float, Envelope[Sample]]]:
    came: list[tuple[float, Envelope[Sample]]] = []
    station.exchange.subscribe("*/watch/**", lambda envelope: came.append((station.loop.time(), envelope)))
    return came


LOSSES = [
    (0.0, False, WORST_PICTURE),
    (0.0, True, WORST_PICTURE),
    (0.2, False, USUAL_PICTURE),
    (0.2, True, USUAL_PICTURE),
]


@pytest.mark.parametrize(("loss", "is_half_duplex", "size"), LOSSES)
def test_a_preview_comes_every_five_seconds_while_status_stays_above_1_hz(
    loss: float, is_half_duplex: bool, size: int
) -> None:
    seen = poll(3, replace(RADIO_CONDITIONS, loss=loss), is_half_duplex=is_half_duplex, size=size)
    gaps_s = [later - earlier for earlier, later in pairwise([3.0, *seen.previews_s, 33.0])]
    assert max(gaps_s) <= 5.0
    assert max(seen.late_s) <= 5.0
    assert seen.slowest_status_hz >= 1.0
    assert seen.samples > 30


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(10))
def test_so_it_is_with_other_luck(seed: int) -> None:
    for loss, is_half_duplex, size in LOSSES[2:]:
        seen = poll(seed, replace(RADIO_CONDITIONS, loss=loss), is_half_duplex=is_half_duplex, size=size)
        gaps_s = [later - earlier for earlier, later in pairwise([3.0, *seen.previews_s, 33.0])]
        assert max(gaps_s) <= 5.0, gaps_s
        assert seen.slowest_status_hz >= 1.0


def test_a_radio_behind_a_network_that_is_taken_for_quick_carries_status_and_pictures_too() -> None:
    seen = poll(2, CLEAN, size=USUAL_PICTURE, budget=LinkBudget(rate_bit_s=2e6, bits_per_byte=8.0))
    assert max(later - earlier for earlier, later in pairwise([3.0, *seen.previews_s, 33.0])) <= 5.0
    assert seen.slowest_status_hz >= 1.0


def test_what_somebody_looks_at_takes_no_more_than_its_share() -> None:
    seen = poll(1, CLEAN)
    assert seen.view_bytes_s <= 0.36 * RADIO.rate_byte_s
    assert seen.sent_bytes_s <= 0.95 * RADIO.rate_byte_s


def test_when_nobody_looks_any_more_the_bytes_on_the_link_go_back() -> None:
    async def fly() -> list[float]:
        station, platform, _ = pair_on(1, CLEAN)
        platform.report(20)
        checked, rates = Looked(platform, 1), []
        for is_on in (False, True, False):
            checked.is_on = is_on
            if is_on:
                checked.show(1.0, True)
                checked.show(10.0, False)
            await asyncio.sleep(4.0)  # what is under way arrives
            before = platform.counters.sent_bytes
            await asyncio.sleep(10.0)
            rates.append((platform.counters.sent_bytes - before) / 10.0)
        station.close()
        return rates

    before, during, after = run_virtual(fly())
    assert during > before + 1000.0
    assert abs(after - before) < 0.05 * before


def test_a_command_is_as_quick_and_a_mission_goes_first_while_somebody_looks() -> None:
    async def fly(is_looking: bool) -> tuple[float, float, int]:
        station, platform, _ = pair_on(5, CLEAN)
        came = watched(station)
        platform.report(20)
        checked = Looked(platform, 1)
        await asyncio.sleep(3.0)
        if is_looking:
            checked.show(1.0, True)
            checked.show(10.0, False)
        await asyncio.sleep(5.0)
        begun_s = station.loop.time()
        pause = station.request(Steer(verb=Verb.PAUSE))
        await asyncio.sleep(3.0)
        load_s, before = station.loop.time(), len(came)
        load = station.request(LoadMission(name="survey", text=text_of(20_000, Random(1), is_random=True)))
        while load not in station.replies:
            await asyncio.sleep(0.05)
        during = len(came) - before
        times = station.replies[pause][0] - begun_s, station.replies[load][0] - load_s
        station.close()
        platform.close()
        return *times, during

    alone, beside = run_virtual(fly(False)), run_virtual(fly(True))
    assert beside[0] < alone[0] + 0.1
    assert beside[1] < 1.05 * alone[1]
    assert beside[2] <= 4


def test_a_newer_picture_takes_the_place_of_one_that_waits_but_not_of_one_under_way() -> None:
    async def fly() -> tuple[list[int], int]:
        station, platform, _ = pair_on(1, CLEAN)
        came = watched(station)
        await asyncio.sleep(3.0)
        checked = Looked(platform, 1)
        for size in range(1000, 1010):  # ten at once
            checked.show(0.001, True, size)
        await asyncio.sleep(10.0)
        sizes = [len(unpack(e, TopicTable().types).payload.data) for _, e in came]
        station.close()
        return sizes, platform.counters.replaced

    sizes, replaced = run_virtual(fly())
    assert sizes == [1009]
    assert replaced == 9

    async def running() -> list[int]:
        station, platform, _ = pair_on(1, CLEAN)
        came = watched(station)
        await asyncio.sleep(3.0)
        checked = Looked(platform, 1)
        for size in range(2000, 2010):
            checked.show(0.001, True, size)
            await asyncio.sleep(0.1)
        await asyncio.sleep(10.0)
        return [len(unpack(e, TopicTable().types).payload.data) for _, e in came]

    assert run_virtual(running()) == [2000, 2009]


def test_a_picture_goes_only_to_the_station_that_looks() -> None:
    async def fly(stations: tuple[str, ...]) -> tuple[int, int]:
        station, platform, _ = pair_on(1, CLEAN)
        came = watched(station)
        await asyncio.sleep(3.0)
        Looked(platform, 1, stations).show(1.0, True)
        await asyncio.sleep(5.0)
        station.close()
        return len(came), platform.counters.undelivered

    assert run_virtual(fly(("254",))) == (0, 0)
    assert run_virtual(fly(("254", "255")))[0] >= 2


def test_samples_do_not_go_over_a_link_on_which_nobody_looks() -> None:
    async def fly(stations: tuple[str, ...]) -> int:
        station, platform, _ = pair_on(1, CLEAN)
        await asyncio.sleep(3.0)
        checked = Looked(platform, 1, stations)
        checked.show(1.0, True)
        checked.show(10.0, False)
        await asyncio.sleep(5.0)
        station.close()
        return platform.counters.view_bytes

    assert run_virtual(fly(("254",))) == 0
    assert run_virtual(fly(("254", "255"))) > 5000


def test_a_picture_that_gets_no_further_is_given_up() -> None:
    async def fly() -> tuple[list[int], int]:
        station, platform, link = pair_on(1, CLEAN)
        came = watched(station)
        await asyncio.sleep(3.0)
        checked = Looked(platform, 1)
        link.b.conditions = replace(CLEAN, loss=1.0)
        checked.show(0.001, True)
        await asyncio.sleep(6.0)
        link.b.conditions = CLEAN
        checked.show(0.001, True, 500)
        await asyncio.sleep(4.0)
        return [len(unpack(e, TopicTable().types).payload.data) for _, e in came], platform.counters.undelivered

    assert run_virtual(fly()) == ([500], 1)
