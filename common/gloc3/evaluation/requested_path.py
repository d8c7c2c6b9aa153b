"""Collects the requested path from the waypoint controllers' requests, for the log and plots of a flight."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec

from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope, FunctionRequest
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import Pose
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.states import ENDED


class RequestedFlight(msgspec.Struct):
    """One action that followed waypoints."""

    action_id: str
    start_s: float
    polyline_ned_m: list[Vector3]
    """Where the vehicle was at the begin, then every waypoint."""
    speed_m_s: float
    end_s: float | None = None
    acceptance_m: float = 0.0
    """So near to a waypoint counts as passed, where the action says it."""
    is_height_kept: bool = False
    """It keeps a distance to the ground below, whatever heights its waypoints have."""
    is_continued: bool = False
    """It goes on where an earlier attempt had come to."""


class RequestedPath:
    """Collects every `follow_waypoints` and `go_to` requested from a component of a platform."""

    def __init__(self, exchange: Exchange, platform: str) -> None:
        self.flights: Final[list[RequestedFlight]] = []
        self.on_change: Callable[[Sequence[Vector3]], None] | None = None
        """Called with the whole path when it has become longer."""
        self._position_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._unsubscribes = [
            exchange.subscribe(f"{platform}/components/*/function", self._receive_request),
            exchange.subscribe(f"{platform}/action_status/*", self._report),
            exchange.subscribe(f"{platform}/pose", self._receive_pose),
        ]

    @property
    def points_ned_m(self) -> list[Vector3]:
        """The whole path, one after the other."""
        return [point for flight in self.flights for point in flight.polyline_ned_m]

    def close(self) -> None:
        """Listens no more."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()

    def _receive_pose(self, envelope: Envelope[Pose]) -> None:
        self._position_ned_m = envelope.payload.position_ned_m

    def _receive_request(self, envelope: Envelope[FunctionRequest]) -> None:
        request = envelope.payload
        order: dict[str, Any] = request.arguments.get("arguments", {})
        if request.function != "action.start" or "waypoints_ned_m" not in order:
            return
        for flight in self.flights:  # motion has one owner: whatever was under way is not any more
            flight.end_s = envelope.t_s if flight.end_s is None else flight.end_s
        points = [(float(n), float(e), float(d)) for n, e, d in order["waypoints_ned_m"]]
        self.flights.append(
            RequestedFlight(
                str(request.arguments.get("action_id", "")),
                envelope.t_s,
                [self._position_ned_m, *points],
                float(order.get("speed_m_s", 0.0)),
                acceptance_m=float(order.get("acceptance_m") or 0.0),
                is_height_kept=order.get("altitude_m") is not None,
                is_continued=bool(request.arguments.get("progress")),
            )
        )
        if self.on_change is not None:
            self.on_change(self.points_ned_m)

    def _report(self, envelope: Envelope[ActionStatus]) -> None:
        status = envelope.payload
        for flight in self.flights:
            if flight.action_id == status.action_id and status.state in ENDED and flight.end_s is None:
                flight.end_s = envelope.t_s
