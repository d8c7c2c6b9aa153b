"""Desk of the vehicle services: finds the selected vehicle, and keeps the loaded data of each."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, Never, TypeAlias

from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.services.descriptions.component_metadata import DescriptionCache
from gloc3_groundstation.services.machines import Wire
from gloc3_groundstation.services.vehicle import VehicleServices
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, Fleet
from gloc3_groundstation.station.station import Station

Reach: TypeAlias = Callable[[str], tuple[Wire, Address]]
"""Gives the link and the autopilot's address of a vehicle by its name, or refuses."""


def nowhere(name: str) -> Never:
    """Where a station has no links."""
    raise Refused(f"this station has no link to {name}")


class _Open(NamedTuple):
    """The services of a vehicle that were opened."""

    services: VehicleServices
    desk: VehicleDesk
    opened_s: float

    def is_over(self, autopilot: AutopilotSnapshot) -> bool:
        """Whether they are of an earlier life of the autopilot; a calibration may ask the operator to restart it."""
        is_earlier = autopilot.restarted_s is not None and autopilot.restarted_s > self.opened_s
        return is_earlier and ServiceKind.CALIBRATION not in self.desk.jobs.running

    async def close(self) -> None:
        await self.desk.close()
        await self.services.close()


class ServicesDesk:
    """The services of all vehicles, each opened when it is first asked for, and again after a restart of its autopilot."""

    def __init__(
        self, station: Station, reach: Reach = nowhere, folder: Path = Path(), kept: Path | None = None
    ) -> None:
        """Creates a desk.

        Args:
            station: receives reports of changes on vehicles.
            reach: finds a vehicle.
            folder: for downloads, and base of typed file names.
            kept: for descriptions of parameters that vehicles have sent; None to keep them in memory.
        """
        self.folder: Final = folder
        self._station = station
        self._reach = reach
        self._descriptions = DescriptionCache(kept)
        self._desks: dict[tuple[Wire, Address], _Open] = {}
        self._closing: set[asyncio.Task[None]] = set()
        self._unlisten = station.listen(self._follow)

    def vehicle(self, name: str) -> VehicleDesk:
        """Desk of one vehicle.

        Raises:
            Refused: no link leads to its autopilot.
        """
        wire, target = self._reach(name)
        if (wire, target) not in self._desks:
            services = VehicleServices(wire, target, self._descriptions)
            desk = VehicleDesk(self._station, services, self.folder)
            self._desks[wire, target] = _Open(services, desk, self._station.now_s())
        desk = self._desks[wire, target].desk
        desk.name = name
        return desk

    async def close(self) -> None:
        """Stops everything; to be awaited before the links are closed."""
        self._unlisten()
        for one in self._desks.values():
            await one.close()
        self._desks.clear()
        await asyncio.gather(*self._closing)

    def _follow(self, before: Fleet, after: Fleet, now_s: float) -> None:
        """Drops what was loaded from an autopilot that has restarted, or whose address another one has now.

        An autopilot that falls silent may be replaced: its motors turn only after another confirmation.
        """
        del before, now_s
        for key, one in list(self._desks.items()):
            platform = after.get(one.desk.name)
            autopilot = platform.autopilot if platform is not None else None
            if autopilot is None or not autopilot.is_alive:
                one.desk.motors.revoke()
            elif one.is_over(autopilot):
                del self._desks[key]
                task = asyncio.get_running_loop().create_task(one.close())
                self._closing.add(task)
                task.add_done_callback(self._closing.discard)


def reached(desk: ServicesDesk, name: str) -> tuple[VehicleDesk | None, str]:
    """Desk of a vehicle; None, and the reason, where it cannot be reached or none is selected."""
    if not name:
        return None, "no vehicle is heard yet"
    try:
        return desk.vehicle(name), ""
    except Refused as error:
        return None, str(error)
