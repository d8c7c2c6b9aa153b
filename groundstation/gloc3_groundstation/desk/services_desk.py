"""Desk of the vehicle services: finds the selected vehicle, and keeps the loaded data of each."""

from collections.abc import Callable
from pathlib import Path
from typing import Final, Never, TypeAlias

from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.services.descriptions.component_metadata import DescriptionCache
from gloc3_groundstation.services.machines import Wire
from gloc3_groundstation.services.vehicle import VehicleServices
from gloc3_groundstation.station.station import Station

Reach: TypeAlias = Callable[[str], tuple[Wire, Address]]
"""Gives the link and the autopilot's address of a vehicle by its name, or refuses."""


def nowhere(name: str) -> Never:
    """Where a station has no links."""
    raise Refused(f"this station has no link to {name}")


class ServicesDesk:
    """The services of all vehicles, each opened when it is first asked for."""

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
        self._desks: dict[tuple[Wire, Address], tuple[VehicleServices, VehicleDesk]] = {}

    def vehicle(self, name: str) -> VehicleDesk:
        """Desk of one vehicle.

        Raises:
            Refused: no link leads to its autopilot.
        """
        wire, target = self._reach(name)
        if (wire, target) not in self._desks:
            services = VehicleServices(wire, target, self._descriptions)
            self._desks[wire, target] = services, VehicleDesk(self._station, services, self.folder)
        _, desk = self._desks[wire, target]
        desk.name = name
        return desk

    async def close(self) -> None:
        """Stops everything; to be awaited before the links are closed."""
        for services, desk in self._desks.values():
            await desk.close()
            await services.close()
        self._desks.clear()


def reached(desk: ServicesDesk, name: str) -> tuple[VehicleDesk | None, str]:
    """Desk of a vehicle; None, and the reason, where it cannot be reached or none is selected."""
    if not name:
        return None, "no vehicle is heard yet"
    try:
        return desk.vehicle(name), ""
    except Refused as error:
        return None, str(error)
