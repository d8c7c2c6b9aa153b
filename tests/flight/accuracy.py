"""A short patrol whose path is judged, and the control flights that are wrong on purpose."""

from collections.abc import Sequence
from typing import Any

import msgspec
from tests.flight.card import Card
from tests.flight.missions import mission

from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3
from gloc3_sitl.flight.path_error import PathResult, path_error
from gloc3_sitl.physics.wind import CALM, Wind

SPEED_M_S = 0.5
LANES = [(1.0, 0.0, 2.0), (8.0, 0.0, 2.0), (8.0, 2.0, 2.0), (1.0, 2.0, 2.0)]
CALM_LIMITS = (0.15, 0.5)
"""RMS and greatest error, in metres."""
WIND_RMS_M = 0.35


def lanes(waypoints: Sequence[Vector3]) -> str:
    """The sweep of a patrol, short."""
    listed = [list(waypoint) for waypoint in waypoints]
    return mission(f"{{out: {{follow_waypoints: {{waypoints_m: {listed}, speed_m_s: {SPEED_M_S}}}}}}}")


def figures(flight: Card, requested: Sequence[Vector3] = LANES) -> PathResult:
    """Of the sweep, against the way that was asked for."""
    reported = {event.text: event.t_s for event in flight.events}
    begin_s, end_s = reported["sweep.out running"], reported.get("sweep.out done", flight.now_s)
    samples = [sample for sample in flight.flight.truth.samples if begin_s <= sample.t_s <= end_s]
    polyline = [samples[0].position_ned_m, *((x, -y, -height) for x, y, height in requested)]
    return path_error(samples, polyline)


def fly(flight: Card, waypoints: Sequence[Vector3] = LANES, wind: Wind = CALM) -> PathResult:
    """Flies the lanes to their end."""
    flight.begin(lanes(waypoints), wind=wind)
    flight.await_state("sweep", "done", 80.0)
    return figures(flight)


def hover(flight: Card) -> PathResult:
    """Stands where the way begins: its setpoints are frozen."""
    flight.begin(lanes(LANES))
    flight.await_state("sweep.out", "running")
    first: list[Vector3] = []

    def freeze(envelope: Envelope[Any]) -> Sequence[Envelope[Any]]:
        first.append(envelope.payload.position_ned_m)
        frozen = msgspec.structs.replace(envelope.payload, position_ned_m=first[0], velocity_ned_m_s=(0.0, 0.0, 0.0))
        return (msgspec.structs.replace(envelope, payload=frozen),)

    flight.flight.exchange.tap(f"{flight.flight.name}/setpoint_wanted/waypoints", freeze)
    flight.wait(15.0)
    return figures(flight)


def skip_a_leg(flight: Card) -> PathResult:
    """Goes straight from the first waypoint to the last."""
    return fly(flight, [LANES[0], LANES[3]])


def cut_corners(flight: Card) -> PathResult:
    """Leaves each leg a metre and a half before its end."""
    return fly(flight, [LANES[0], (6.5, 0.0, 2.0), (8.0, 1.0, 2.0), (6.5, 2.0, 2.0), LANES[3]])
