"""The truth beside a flight's poses: of the same time, and in the same frame."""

import asyncio
from math import nan
from typing import Any

import pytest
from msgspec.structs import replace

from gloc3.clock import VirtualLoop
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import IDENTITY, Vector3
from gloc3.messages.vehicle import Pose
from gloc3_sitl.flight.truth import FlightTruth
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World

WRONG_M = 1.65
"""By so much the receiver's altitude of the surface is off."""


def published(truth: Truth, surface_m: float | None, first: Vector3 | None = None) -> Envelope[Any]:
    """The truth that is published while a pose counts from a wrong altitude, after one from another origin."""
    found: list[Envelope[Any]] = []

    async def watch() -> None:
        exchange, loop = LocalExchange(), asyncio.get_running_loop()
        flight = FlightTruth(exchange, "one", loop, 1, lambda: truth, lambda _: None, surface_m)
        exchange.subscribe("one/sim/truth", found.append)
        origin = (truth.latitude_deg, truth.longitude_deg, truth.altitude_m - WRONG_M)
        still: Vector3 = (0.0, 0.0, 0.0)
        publisher = Publisher(exchange, "one", "pose", 1)
        for each in (origin,) if first is None else (first, origin):
            pose = Pose(position_ned_m=still, velocity_ned_m_s=still, ned_from_frd=IDENTITY, origin_geo=each)
            publisher.publish("one/pose", pose, 0.0, "ned")
        await asyncio.sleep(0.0)
        flight.begin()
        await asyncio.sleep(0.0)
        flight.close()

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(watch())
    return found[-1]


@pytest.fixture
def truth() -> Truth:
    """Of a vehicle at rest, 20 ms before now."""
    still = Simulator(World.load("bay"), SimulatorSettings(vehicle="auv")).truth()
    return replace(still, t_s=-0.02)


def test_the_truth_is_stamped_with_the_time_of_the_physics(truth: Truth) -> None:
    assert published(truth, None).t_s == pytest.approx(-0.02)


def test_the_depth_of_what_dives_counts_from_the_surface(truth: Truth) -> None:
    assert published(truth, None).payload.position_ned_m[2] == pytest.approx(-WRONG_M)
    assert published(truth, truth.altitude_m + 3.0).payload.position_ned_m[2] == pytest.approx(3.0)


def test_an_origin_that_is_not_a_number_is_not_taken(truth: Truth) -> None:
    spoiled = published(truth, None, (nan, nan, nan))
    assert spoiled.payload.position_ned_m[2] == pytest.approx(-WRONG_M)
