"""Vehicles of one mission with open tasks, in virtual time: their platform files, their places, and the way to its start."""

from pathlib import Path

from tests.flight.fleet_flight import FleetFlight

from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.mission.assigning.assignment import TaskAssignment
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import Follower
from gloc3_groundstation.missions.plans import read_plan
from gloc3_groundstation.shared_missions.assigning import assigned
from gloc3_groundstation.shared_missions.shared_flight import SharedFlight
from gloc3_groundstation.station.station import Station
from gloc3_sitl.flight.plan import FlightPlan

FIELD = GeoPoint(47.4, 8.55, 488.0)


def at(north_m: float, east_m: float) -> GeoPoint:
    """A place in the field."""
    return TangentPlane(FIELD).geo_from_ned((north_m, east_m, 0.0))


def corner(north_m: float, east_m: float) -> str:
    """The same as a mission's text has it."""
    place = at(north_m, east_m)
    return f"[{place.latitude_deg:.7f}, {place.longitude_deg:.7f}]"


def block(north_m: float, east_m: float, *, size_m: float = 8.0, spacing_m: float = 4.0) -> str:
    """A survey of a square."""
    corners = [(0.0, 0.0), (size_m, 0.0), (size_m, size_m), (0.0, size_m)]
    area = ", ".join(corner(north_m + north, east_m + east) for north, east in corners)
    return f"{{survey: {{area: [{area}], spacing_m: {spacing_m:g}, height_m: 4, speed_m_s: 2}}}}"


class SharedMission:
    """A mission and the vehicles that fly it.

    Args:
        folder: for their files.
        text: the mission.
        places: name of a vehicle to its home, metres north and east.
        kinds: name to the platform that it extends; `pelican_rtk` for others.
    """

    def __init__(
        self,
        folder: Path,
        text: str,
        places: dict[str, tuple[float, float]],
        kinds: dict[str, str] | None = None,
        limits: str = "",
    ) -> None:
        self.mission = folder / "shared.yaml"
        self.mission.write_text(text)
        self.places = places
        self.files: dict[str, str] = {}
        for name in places:
            kind = (kinds or {}).get(name, "pelican_rtk")
            file = folder / f"{name}.yaml"
            file.write_text(f"extends: {kind}\nplatform: {name}\n" + limits)
            self.files[name] = str(file)

    def fleet(self, stations: int = 1) -> FleetFlight:
        """The vehicles, each at its home."""
        plans = [
            FlightPlan(mission=str(self.mission), platform=self.files[name], home=at(*place), seed=number)
            for number, (name, place) in enumerate(self.places.items())
        ]
        return FleetFlight(plans, stations)

    async def start(self, station: Station) -> dict[str, Follower]:
        """Waits for the vehicles, uploads a mission whose tasks all name their platform, and starts it."""
        plan = read_plan(str(self.mission))
        await self._ready(station)
        await flights.stream_to_all(station, plan.platforms, plan)
        return await flights.start_all(station, plan.platforms)

    async def begun(self, station: Station) -> tuple[SharedFlight, TaskAssignment]:
        """Waits for the vehicles, assigns, uploads and starts."""
        await self._ready(station)
        files = tuple(self.files.values())
        plan, found = assigned(station, read_plan(str(self.mission)), tuple(self.places), files)
        await flights.stream_to_all(station, plan.platforms, plan)
        flight = SharedFlight(station, plan, files)
        flight.begin(await flights.start_all(station, plan.platforms))
        return flight, found

    async def _ready(self, station: Station) -> None:
        for name in self.places:
            await flights.await_platform(station, name)
            assert not await flights.await_ready(station, name)
