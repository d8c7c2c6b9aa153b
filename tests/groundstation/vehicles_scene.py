"""A station with two links in virtual time, autopilots that speak on them, and companions."""

import asyncio
from collections.abc import Awaitable, Callable
from random import Random
from typing import Any, TypeVar

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange
from gloc3.exchange.mavlink import MavlinkExchange, TunnelEndpoint, TunnelRole
from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.station.vehicles import Vehicles

from .scripted_platform import ScriptedPlatform

T = TypeVar("T")
TOPICS = TopicTable.installed()
PX4, ARDUPILOT, SMARTAP = 12, 3, 18
BRAKE = 17


class Autopilot:
    """Speaks as an autopilot on one link, once a second while it is switched on."""

    def __init__(self, memory: MemoryLink, autopilot: int, system: int = 1, **beat: Any) -> None:
        self._encoder, self._send = Encoder(system, 1), memory.b.send
        self._loop = asyncio.get_running_loop()
        self.beat = {"type": 2, "autopilot": autopilot, **beat}
        self.booted_s = self._loop.time()
        self.is_on = True
        self._tick()

    def report(self, name: str, *others: "Autopilot", **fields: Any) -> None:
        """Sends a message; a router sends the same frame by the links of others, too."""
        data = self._encoder.encode(message(name, **fields))
        for autopilot in (self, *others):
            autopilot._send(data)

    def _tick(self) -> None:
        self._loop.call_later(1.0, self._tick)
        if self.is_on:
            self.report("HEARTBEAT", **self.beat)
            self.report("SYSTEM_TIME", time_boot_ms=int(1000 * (self._loop.time() - self.booted_s)))


class Scene:
    """A station with two links."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        exchange = LocalExchange()
        self.station = Station(exchange, loop, "255", 11)
        self.memories = [MemoryLink(loop, Random(n)) for n in range(2)]
        self.links: list[tuple[str, StationLinkCore]] = []
        for number, memory in enumerate(self.memories):
            link = StationLinkCore(memory.a.send, LinkContext(loop=loop, exchange=exchange, topics=TOPICS, boot=11))
            memory.a.on_data = link.receive
            self.links.append((f"udpin://0.0.0.0:{14550 + number}", link))
        self.vehicles = Vehicles(self.station, lambda: self.links)

    def platform(self, name: str) -> PlatformSnapshot:
        found = self.station.fleet.get(name)
        assert found is not None, list(self.station.fleet.platforms)
        return found

    def companion(self, number: int, name: str = "heron", system: int = 1) -> MavlinkExchange:
        """A platform's companion on a link, that speaks twice a second."""
        memory, there, address = self.memories[number], LocalExchange(), Address(system, 191)
        platform, encoder = ScriptedPlatform(there, name), Encoder(*address)
        end = TunnelEndpoint(TunnelRole.PLATFORM, name, address, 99, TOPICS)
        tunnel = MavlinkExchange(end, platform.loop, lambda sent: memory.b.send(encoder.encode(sent)))
        tunnel.bridge(there, TOPICS, name)

        def handle(data: bytes) -> None:
            for frame in Parser(is_datagram=True).receive(data):
                decoded = frame.decode()
                if decoded is not None:
                    tunnel.receive(decoded, frame.sender)

        memory.b.on_data = handle
        platform.loop.call_later(0.3, platform.speak_every, 0.5)
        return tunnel

    async def pass_s(self, seconds: float) -> None:
        ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().call_later(seconds, ended.set_result, None)
        await ended

    def texts(self) -> list[str]:
        return [event.text for event in self.station.fleet.events]


def over(play: Callable[[Scene], Awaitable[T]]) -> T:
    async def main() -> T:
        scene = Scene()
        try:
            return await play(scene)
        finally:
            scene.vehicles.close()
            scene.station.close()
            for _, link in scene.links:
                link.close()

    return run_virtual(main())
