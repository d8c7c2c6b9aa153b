"""Several vehicles and several stations in one process on one virtual clock: each vehicle the whole stack of a flight."""

import asyncio
from collections.abc import Sequence
from contextlib import AsyncExitStack
from random import Random
from types import TracebackType
from typing import Final, Self

import msgspec

from gloc3.mavlink.transport.memory import MemoryLink
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

STATION_ID: Final = 255


class FleetGround(GroundStation):
    """A station with a link of its own to each vehicle."""

    def __init__(self, setup: StationSetup) -> None:
        super().__init__(setup)
        self.radios: Final[dict[str, MemoryLink]] = {}
        """The first link to each vehicle."""

    def join(self, name: str, radio: MemoryLink) -> None:
        """Opens a link to a vehicle, the first or one more."""
        self.radios.setdefault(name, radio)
        self.attach(radio.a)


class FleetFlight:
    """Vehicles that fly at the same time, and stations that hear all of them; an asynchronous context.

    Args:
        plans: a vehicle each; their platforms have different names.
        stations: how many, from 255 down.
        seed: of the stations.
    """

    def __init__(self, plans: Sequence[FlightPlan], stations: int = 1, seed: int = 0) -> None:
        self.loop: Final = asyncio.get_running_loop()
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
            await ground.close()
        await self._stack.aclose()

    def add_station(self, system: int) -> FleetGround:
        """One more station, while they fly."""
        ground = self._ground(system)
        self.grounds.append(ground)
        self._join(ground)
        return ground

    def _ground(self, system: int) -> FleetGround:
        return FleetGround(StationSetup(boot=self._random.getrandbits(32), system=system))

    def _join(self, ground: FleetGround) -> None:
        for name, flight in self.flights.items():
            ground.join(name, flight.process.add_radio())
