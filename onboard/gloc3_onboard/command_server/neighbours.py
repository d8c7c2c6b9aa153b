"""Other vehicles, as the station in control passes them on to the limiter, and the limiter's answers for the stations."""

from gloc3.component.ports import Inbox, Input, Keep, Output, PortGroup
from gloc3.messages.command_interface import NearbyVehicle
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.neighbours import Neighbour, Neighbours, SeparationState
from gloc3.messages.summaries import EventReport


class NeighbourPorts(PortGroup):
    """The limiter's answer, and what it is told."""

    separation = Input(SeparationState, Keep.ALL)

    neighbours = Output(Neighbours)


class NeighbourReports:
    """Converts reports on other vehicles into the vehicle's own frame.

    Args:
        name: of this platform.
        report: sends an event to the stations.
    """

    def __init__(self, name: str, report: EventReport) -> None:
        self._name, self._report = name, report
        self._last = SeparationState()
        self._waiting: Neighbours | None = None

    def receive(self, vehicles: list[NearbyVehicle], origin: GeoPoint | None, now_s: float) -> None:
        """Handles a report of the station in control; without an origin of NED there is no place for it."""
        if origin is None:
            return
        plane = TangentPlane(origin)
        self._waiting = Neighbours(
            vehicles=[
                Neighbour(
                    name=one.name,
                    position_ned_m=plane.ned_from_geo(*one.geo),
                    velocity_ned_m_s=one.velocity_ned_m_s,
                    t_s=now_s - one.age_s,
                    has_priority=one.is_traffic or one.name < self._name,
                )
                for one in vehicles
                if one.name != self._name
            ]
        )

    def collect(self) -> list[Neighbours]:
        """The last report, once."""
        found, self._waiting = self._waiting, None
        return [] if found is None else [found]

    def observe(self, inbox: Inbox) -> None:
        """Tells the stations when the limiter begins and ends to keep the vehicle away from another one."""
        for state in inbox.new(NeighbourPorts.separation):
            last, self._last = self._last, state.payload
            now = state.payload
            if now.name and (now.name, now.has_priority) != (last.name, last.has_priority):
                what = "gives way to" if now.has_priority else "brakes for"
                text = f"{what} {now.name}, {now.distance_m:.1f} m away"
                self._report(Severity.NOTICE if now.has_priority else Severity.WARNING, text)
            elif last.name and not now.name:
                self._report(Severity.INFO, f"{last.name} is out of the way")
