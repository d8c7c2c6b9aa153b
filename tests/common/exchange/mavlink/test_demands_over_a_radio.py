"""Velocities that are asked for by hand cross a radio at once or not at all: one frame each, the newest counts."""

import asyncio
from random import Random
from typing import Any

import pytest
from tests.common.exchange.mavlink.ends import PLATFORM, PLATFORM_ADDRESS, RADIO_CONDITIONS, Platform, Station

from gloc3.clock import run_virtual
from gloc3.exchange.tunnel.body import pack_status
from gloc3.exchange.tunnel.layout import MAX_PAYLOAD
from gloc3.mavlink.message import Address
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.teleoperation import DEMAND_HZ, EXPIRES_S, VelocityDemand
from gloc3.messages.wire import type_name

OTHER = "other"
SECONDS = 30


def demand(sequence: int) -> VelocityDemand:
    return VelocityDemand(
        sender="255", session=2**32 - 1, sequence=sequence, velocity_cm_s=(-150, 150, -60), yaw_rate_cdeg_s=-9000
    )


async def _steer() -> tuple[list[tuple[float, Envelope[Any]]], list[str], int]:
    loop, random = asyncio.get_running_loop(), Random(4)
    links = [MemoryLink(loop, random, RADIO_CONDITIONS) for _ in range(2)]
    station = Station(random.getrandbits(32), *(link.a for link in links))
    steered = Platform(random.getrandbits(32), links[0].b)
    other = Platform(random.getrandbits(32), links[1].b, name=OTHER, address=Address(PLATFORM_ADDRESS.system + 1, 191))
    came: list[tuple[float, Envelope[Any]]] = []
    steered.exchange.subscribe(f"{PLATFORM}/velocity_demand", lambda e: came.append((loop.time(), e)))
    strayed: list[Any] = []
    other.exchange.subscribe("*/velocity_demand", strayed.append)
    await asyncio.sleep(5.0)
    for sequence in range(round(SECONDS * DEMAND_HZ)):
        station.publisher.publish(f"{PLATFORM}/velocity_demand", demand(sequence), loop.time())
        await asyncio.sleep(1.0 / DEMAND_HZ)
    problems = [*steered.problems(), *other.problems()]
    for end in (station, steered, other):
        end.close()
    return came, problems, len(strayed)


@pytest.mark.thorough
def test_of_ten_a_second_most_arrive_in_order_and_never_late() -> None:
    came, problems, strayed = run_virtual(_steer())
    sequences = [envelope.payload.sequence for _, envelope in came]
    assert sequences == sorted(set(sequences))
    assert len(sequences) > 0.6 * SECONDS * DEMAND_HZ, "one frame in five is lost"
    assert max(now_s - envelope.t_s for now_s, envelope in came) < EXPIRES_S
    assert (problems, strayed) == ([], 0), "what is for one platform is nothing that another complains of"


def test_one_takes_less_than_half_of_a_frame() -> None:
    payload = demand(100_000)
    envelope = Envelope("rov/velocity_demand", Source("", "", 0), 1, 1e5, "", type_name(VelocityDemand), payload)
    assert len(pack_status(envelope)) < MAX_PAYLOAD / 2
