"""The simulator: time by hand and by a loop, links in memory, the world under the vehicle."""

import asyncio
from random import Random

import pytest

from gloc3.clock import run_virtual
from gloc3.errors import Misuse, Refused
from gloc3.mavlink.codec import Parser
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.world import World

pytestmark = pytest.mark.thorough


def test_it_advances_in_whole_steps_and_never_back() -> None:
    simulator = Simulator(World.load("open"))
    simulator.advance(0.5)
    assert simulator.now_s == pytest.approx(0.5)
    simulator.advance(0.2)
    assert simulator.now_s == pytest.approx(0.5)


def test_many_small_steps_are_the_same_as_one_large_one() -> None:
    places = []
    for step in (2.0, 0.02, 0.004):
        simulator = Simulator(World.load("open"), SimulatorSettings(seed=3))
        for count in range(1, round(2.0 / step) + 1):
            simulator.advance(count * step)
        places.append((simulator.now_s, simulator.autopilot.estimator.position_ned_m))
    assert places[0] == places[1] == places[2]


def test_a_loop_in_virtual_time_drives_it_and_its_links() -> None:
    received: list[str] = []

    async def fly() -> float:
        loop = asyncio.get_running_loop()
        simulator = Simulator(World.load("open"), SimulatorSettings(seed=1))
        link = MemoryLink(loop, Random(1), Conditions(latency_s=0.01))
        parser = Parser(is_datagram=True)

        def receive(data: bytes) -> None:
            received.extend(frame.shape.name for frame in parser.receive(data) if frame.shape is not None)

        link.a.on_data = receive
        link.b.on_data = simulator.attach(link.b.send, LinkKind.GROUND)
        simulator.start(loop)
        await asyncio.sleep(3.0)
        simulator.stop()
        await asyncio.sleep(1.0)
        return simulator.now_s

    assert run_virtual(fly()) == pytest.approx(3.0, abs=0.03)
    assert received.count("HEARTBEAT") in (3, 4)


def test_it_can_run_faster_than_its_loop() -> None:
    async def fly() -> float:
        simulator = Simulator(World.load("open"))
        simulator.start(asyncio.get_running_loop(), speed=10.0)
        await asyncio.sleep(0.5)
        return simulator.now_s

    assert run_virtual(fly()) == pytest.approx(5.0, abs=0.05)


def test_a_home_and_parameters_are_taken() -> None:
    home = GeoPoint(47.0, 8.0, 500.0)
    simulator = Simulator(World.load("open", home, 90.0), SimulatorSettings(parameters={"NAV_DLL_ACT": 2}))
    assert simulator.truth().latitude_deg == pytest.approx(47.0)
    assert simulator.truth().altitude_m == pytest.approx(500.0, abs=0.01)
    assert simulator.autopilot.parameters["NAV_DLL_ACT"] == 2


def test_styles_and_parameters_that_do_not_exist_are_named() -> None:
    with pytest.raises(Misuse, match="px4"):
        Simulator(World.load("open"), SimulatorSettings(style="px"))
    with pytest.raises(Refused, match="NAV_DLL_ACT"):
        Simulator(World.load("open"), SimulatorSettings(parameters={"NAV_DLL_AKT": 2}))


def test_what_the_autopilot_says_is_kept() -> None:
    simulator = Simulator(World.load("open"))
    simulator.advance(0.1)
    simulator.autopilot.commander.arm(Author.COMMAND)
    assert simulator.texts[-1][2].startswith("Arming denied")
