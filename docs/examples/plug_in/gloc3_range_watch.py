"""Distances of the vehicles from the origin of their frame: a screen, a line of the overview, and an alert rule."""

from collections.abc import Iterator
from math import hypot

from gloc3.messages.envelope import Severity
from gloc3_groundstation.plug_ins import PlugInScreen
from gloc3_groundstation.station.alerts import AlertCause
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

FAR_M = 100.0


def range_m(platform: PlatformSnapshot) -> float | None:
    """Horizontal distance from the origin, m; None where it is not known."""
    vehicle = platform.vehicle.value if platform.vehicle is not None else None
    if vehicle is None or not vehicle.is_pose_valid:
        return None
    return hypot(vehicle.position_m[0], vehicle.position_m[1])


def overview_line(platform: PlatformSnapshot, now_s: float) -> str:
    """The distance of the vehicle in view."""
    distance_m = range_m(platform)
    return "" if distance_m is None else f"{distance_m:.0f} m from the origin"


def rule(fleet: Fleet, now_s: float) -> Iterator[AlertCause]:
    """Warns of vehicles that are far away."""
    for platform in fleet:
        distance_m = range_m(platform)
        if distance_m is not None and distance_m > FAR_M:
            yield AlertCause(platform.name, "range", Severity.WARNING, f"more than {FAR_M:.0f} m from the origin")


def lines(fleet: Fleet, platform: PlatformSnapshot | None, now_s: float) -> list[str]:
    """The distances of all vehicles."""
    return [f"{one.name:<16}{overview_line(one, now_s) or 'unknown'}" for one in fleet]


SCREEN = PlugInScreen(title="Range", help="The distance of each vehicle from the origin of its frame.", lines=lines)
