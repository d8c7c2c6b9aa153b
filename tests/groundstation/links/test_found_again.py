"""Station and platform find each other again: after an hour of silence, from another address, after a sleep."""

import asyncio
import gc
from collections.abc import Awaitable, Callable
from random import Random
from typing import TypeVar

import pytest
from tests.direct_link import wire, wire_url
from tests.groundstation.scripted_platform import ScriptedPlatform

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.command_interface import Hello, Outcome, Steer, Verb
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.desk import flights
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.station.station import Station
from gloc3_onboard.companion.station_link import StationLink

pytestmark = pytest.mark.thorough

T = TypeVar("T")
TOPICS = TopicTable.installed()
HOUR_S = 3600.0
CUT = Conditions(loss=1.0)
FOUND_S = 10.0


class Ends:
    """A platform's link to stations, a station's link, and what is between them."""

    def __init__(self, memory: MemoryLink) -> None:
        loop = asyncio.get_running_loop()
        self.memory = memory
        there, here = LocalExchange(), LocalExchange()
        self.platform = ScriptedPlatform(there)
        self.onboard = StationLink(self.platform.name, 1, loop, there, TOPICS, 7)
        wire(self.onboard, memory.b, loop)
        self.station = Station(here, loop, "255", 11)
        self.link = StationLinkCore(
            memory.a.send,
            LinkContext(loop=loop, exchange=here, topics=TOPICS, boot=11, undelivered=self.station.client.undelivered),
        )
        memory.a.on_data = self.link.receive
        loop.call_later(0.3, self.platform.speak_every, 0.5)

    def close(self) -> None:
        self.station.close()
        self.link.close()
        self.onboard.close()


def between(play: Callable[[Ends], Awaitable[T]]) -> T:
    async def main() -> T:
        ends = Ends(MemoryLink(asyncio.get_running_loop(), Random(3), Conditions(latency_s=0.05)))
        try:
            await flights.await_platform(ends.station, None)
            return await play(ends)
        finally:
            ends.close()

    return run_virtual(main())


async def found_again(ends: Ends) -> None:
    """Within seconds the platform is heard, and does what it is asked."""
    name = ends.platform.name
    began_s = ends.station.now_s()
    async with asyncio.timeout(FOUND_S):
        while (known := ends.station.fleet.get(name)) is None or known.received_s < began_s:
            await asyncio.sleep(0.05)
        assert (await ends.station.client.request(name, Steer(verb=Verb.PAUSE))).outcome is Outcome.ACCEPTED


def test_after_an_hour_of_silence_everything_works_within_seconds_and_nothing_has_piled_up() -> None:
    async def play(ends: Ends) -> None:
        await asyncio.sleep(60.0)
        gc.collect()
        before = len(gc.get_objects())
        ends.memory.set_conditions(CUT)
        for _ in range(60):
            reply = await ends.station.client.request(ends.platform.name, Hello())
            assert reply.outcome is not Outcome.ACCEPTED
            await asyncio.sleep(HOUR_S / 60.0 - 16.0)
        gc.collect()
        assert len(gc.get_objects()) - before < 3000, "who is alone for an hour keeps nothing of it"
        ends.memory.set_conditions(Conditions(latency_s=0.05))
        await found_again(ends)

    between(play)


@pytest.mark.parametrize("who", ["platform", "station"])
def test_an_end_that_did_not_hear_or_was_not_heard_for_long_is_found_again(who: str) -> None:
    """As a computer that sleeps, or a vehicle behind a hill: one direction dies first."""

    async def play(ends: Ends) -> None:
        end = ends.memory.b if who == "platform" else ends.memory.a
        end.conditions = CUT
        await asyncio.sleep(HOUR_S / 6.0)
        end.conditions = Conditions(latency_s=0.05)
        await found_again(ends)

    between(play)


@pytest.mark.sockets
async def test_a_station_that_speaks_from_another_address_is_answered_there() -> None:
    """As after a change from one network to another, or behind a router that has forgotten it."""
    loop = asyncio.get_running_loop()
    there, here = LocalExchange(), LocalExchange()
    platform = ScriptedPlatform(there)
    onboard = StationLink(platform.name, 1, loop, there, TOPICS, 7)
    server = await wire_url(onboard, "udpin://127.0.0.1:0", loop)
    platform.speak_every(0.2)
    station = Station(here, loop, "255", 11)
    lines: list[Endpoint] = []

    async def go_online() -> None:
        lines.append(await open_endpoint(f"udpout://127.0.0.1:{server.local_port}", loop, link.receive))

    link = StationLinkCore(
        lambda data: lines[-1].send(data) if lines else None,
        LinkContext(loop=loop, exchange=here, topics=TOPICS, boot=11, undelivered=station.client.undelivered),
    )
    try:
        await go_online()
        ports = [lines[-1].local_port]
        assert (await station.client.request(platform.name, Hello())).outcome is Outcome.ACCEPTED
        await lines[-1].close()
        await go_online()
        ports.append(lines[-1].local_port)
        assert ports[0] != ports[1]
        assert (await station.client.request(platform.name, Steer(verb=Verb.PAUSE))).outcome is Outcome.ACCEPTED
        sent = [body for body in platform.requests if isinstance(body, Steer)]
        assert len(sent) == 1
    finally:
        station.close()
        link.close()
        onboard.close()
        await lines[-1].close()
        await server.close()
