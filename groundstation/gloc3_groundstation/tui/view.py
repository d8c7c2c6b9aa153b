"""The data a screen shows: the station's state at one moment, immutable."""

from typing import NamedTuple

from gloc3_groundstation.desk.desk import Move
from gloc3_groundstation.mapping.tracks import Tracks
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.alerts import Alerts, answer
from gloc3_groundstation.station.snapshots import Fleet, FleetEvent, PlatformSnapshot


class StationView(NamedTuple):
    """One moment of the station. Two views of the same moment are equal, and are shown alike."""

    fleet: Fleet
    platform: PlatformSnapshot | None
    """The selected vehicle; None before the first contact."""
    now_s: float
    """On the station's clock, as all times of the fleet."""
    started_s: float
    """When the station started; times shown to people count from here."""
    station: str
    """The id of this station, such as `255`."""
    moves: frozenset[Move] = frozenset()
    """Actions that make sense for the selected vehicle."""
    actions: tuple[Action, ...] = ()
    """Commands to its autopilot itself that make sense."""
    plan: CheckedPlan | None = None
    """The selected mission."""
    alerts: Alerts = Alerts()
    round_trip_s: float | None = None
    """Round-trip time to the selected vehicle, s; None while it is unknown."""
    tracks: Tracks = Tracks()
    """What was before: it grows, so views of different moments share it."""
    further: tuple[tuple[str, str], ...] = ()
    """Names and texts of lines about the selected vehicle by plug-ins."""
    waiting_for: str = "the link"
    """What is listened to."""

    @property
    def number(self) -> int:
        """Number of the selected vehicle in the fleet, from 1; 0 before the first contact."""
        return list(self.fleet.platforms).index(self.platform.name) + 1 if self.platform is not None else 0

    @property
    def refusal(self) -> FleetEvent | None:
        """The refusal of a request that is shown in place of an alert; None without a recent one."""
        return answer(self.alerts, self.fleet, self.now_s)

    @property
    def is_in_control(self) -> bool:
        """Whether this station holds control of the vehicle in view."""
        control = self.platform.control if self.platform is not None else None
        return control is not None and control.value.holder == self.station
