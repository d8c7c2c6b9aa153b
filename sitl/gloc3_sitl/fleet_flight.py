"""Several vehicles and several stations in one process on one virtual clock: each vehicle the whole stack of a flight."""

import asyncio
from collections.abc import Sequence
from contextlib import AsyncExitStack
from functools import partial
from random import Random
from types import TracebackType
from typing import Final, Self

import msgspec

from gloc3.exchange import LocalExchange
from gloc3.exchange.tunnel.happenings import Undelivered
from gloc3.link.memory import MemoryLink
from gloc3.topics import TopicTable
from gloc3_groundstation.link import Link
from gloc3_groundstation.station import Station
from gloc3_groundstation.ways import NETWORK, Way, Ways
from gloc3_sitl.flight import Flight, FlightPlan
from gloc3_sitl.ground_side import STATION_ID


class FleetGround:
    """A station with a link of its own to each vehicle.

    Args:
        loop: the virtual one.
        topics: the topics that are known.
        boot: a random number for this start of the station.
        system: the station's MAVLink system.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, topics: TopicTable, boot: int, system: int) -> None:
        self._loop, self._topics, self._boot, self._system = loop, topics, boot, system
        self.exchange: Final = LocalExchange()
        self.station: Final = Station(self.exchange, loop, str(system), boot)
        self.radios: Final[dict[str, MemoryLink]] = {}
        """The first link to each vehicle."""
        self._links: list[Link] = []
        self._ways = Ways()

    def join(self, name: str, radio: MemoryLink) -> None:
        """Opens a link to a vehicle, the first or one more."""
        end = radio.a
        self.radios.setdefault(name, radio)
        made: list[Link] = []
        way = self._ways.open(Way(NETWORK, lambda platform: made[0].age_s(platform) if made else None))
        link = Link(
            end.send,
            loop=self._loop,
            exchange=self.exchange,
            topics=self._topics,
            system=self._system,
            boot=self._boot,
            told=lambda _: None,
            undelivered=partial(self._give_up, way),
            carries=partial(self._ways.carries, way),
            is_new=partial(self._ways.is_new, way),
        )
        made.append(link)
        end.on_data = link.receive
        self._links.append(link)

    def _give_up(self, way: int, lost: Undelivered) -> None:
        if self._ways.is_lost(way, lost):
            self.station.client.undelivered(lost)

    def close(self) -> None:
        """Falls silent, as when its process ends."""
        self.station.close()
        for link in self._links:
            link.close()
        self._links.clear()


class FleetFlight:
    """Vehicles that fly at the same time, and stations that hear all of them; an asynchronous context.

    Args:
        plans: a vehicle each; their platforms have different names.
        stations: how many, from 255 down.
        seed: of the stations.
    """

    def __init__(self, plans: Sequence[FlightPlan], stations: int = 1, seed: int = 0) -> None:
        self.loop: Final = asyncio.get_running_loop()
        self.topics: Final = TopicTable.installed()
        alone = (msgspec.structs.replace(plan, has_station=False) for plan in plans)
        self.flights: Final = {flight.name: flight for flight in map(Flight, alone)}
        self._random = Random(seed)
        self._stack = AsyncExitStack()
        self.grounds: Final[list[FleetGround]] = [self._ground(STATION_ID - number) for number in range(stations)]

    async def __aenter__(self) -> Self:
        """Starts everything."""
        for flight in self.flights.values():
            await self._stack.enter_async_context(flight)
        for ground in self.grounds:
            self._join(ground)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends everything."""
        for ground in self.grounds:
            ground.close()
        await self._stack.aclose()

    def add_station(self, system: int) -> FleetGround:
        """One more station, while they fly."""
        ground = self._ground(system)
        self.grounds.append(ground)
        self._join(ground)
        return ground

    def _ground(self, system: int) -> FleetGround:
        return FleetGround(self.loop, self.topics, self._random.getrandbits(32), system)

    def _join(self, ground: FleetGround) -> None:
        for name, flight in self.flights.items():
            ground.join(name, flight.add_radio())
