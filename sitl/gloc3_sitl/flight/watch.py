"""Follows a flight for its report."""

from collections.abc import Callable
from math import hypot

from gloc3.evaluation.requested_path import RequestedPath
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import CiEvent, MissionSummary
from gloc3.messages.vehicle import AutopilotState, ImageRecorded, LandedState, Pose
from gloc3_sitl.flight.report import FlightReport

Narrate = Callable[[str], None]


class FlightWatch:
    """Collects the report's data from a platform's topics, live or from a log, and narrates."""

    def __init__(
        self,
        exchange: Exchange,
        name: str,
        mission: str,
        autopilot: str,
        seed: int = 0,
        narrate: Narrate | None = None,
        battery_wh: float = 0.0,
    ) -> None:
        self.report = FlightReport(
            mission=mission, mission_state="waiting", platform=name, autopilot=autopilot, seed=seed
        )
        self.path = RequestedPath(exchange, name)
        self._narrate = narrate
        self._airborne_s: float | None = None
        self._started_s: float | None = None
        self._battery_wh = battery_wh
        self._full: float | None = None
        """The share of the battery at the start of the mission."""
        subscribe = exchange.subscribe
        subscribe(f"{name}/ci/event", self._event)
        subscribe(f"{name}/ci/mission", self._mission)
        subscribe(f"{name}/autopilot", self._autopilot)
        subscribe(f"{name}/pose", self._pose)
        subscribe(f"{name}/image_recorded", self._image)

    def land(self, now_s: float) -> None:
        """Ends the collection after landing or at the end."""
        if self._airborne_s is not None:
            self.report.flight_time_s = round(self.report.flight_time_s + now_s - self._airborne_s, 3)
            self._airborne_s = None

    def _event(self, envelope: Envelope[CiEvent]) -> None:
        event = envelope.payload
        line = f"{event.t_s:8.2f} s  {event.source}: {event.text}"
        self.report.events.append(line.strip())
        if self._narrate is not None:
            self._narrate(line)

    def _mission(self, envelope: Envelope[MissionSummary]) -> None:
        mission = envelope.payload
        if mission.state == "running" and self._started_s is None:
            self._started_s = envelope.t_s
        if mission.state and self._started_s is not None:
            if mission.state != self.report.mission_state:
                self.report.mission_time_s = round(envelope.t_s - self._started_s, 3)
            self.report.mission_state, self.report.reason = mission.state, mission.reason
            self.report.tasks = dict(mission.tasks)

    def _pose(self, envelope: Envelope[Pose]) -> None:
        pose = envelope.payload
        if pose.is_valid and self.report.mission_state in ("waiting", "running", "paused"):
            self.report.position_std_m = round(hypot(*pose.position_std_m[:2]), 3)

    def _autopilot(self, envelope: Envelope[AutopilotState]) -> None:
        state = envelope.payload
        is_airborne = state.is_armed and state.landed is not LandedState.ON_GROUND
        if is_airborne and self._airborne_s is None:
            self._airborne_s = envelope.t_s
        elif not is_airborne:
            self.land(envelope.t_s)
        if state.battery_remaining >= 0.0:
            self.report.battery_remaining = round(state.battery_remaining, 3)
            if self._full is None and self._started_s is not None:
                self._full = state.battery_remaining
            if self._full is not None and self._battery_wh:
                used_wh = (self._full - state.battery_remaining) * self._battery_wh
                self.report.energy_wh = round(used_wh, 2)

    def _image(self, envelope: Envelope[ImageRecorded]) -> None:
        self.report.images += 1
