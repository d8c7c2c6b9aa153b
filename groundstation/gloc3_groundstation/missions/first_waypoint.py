"""Distance from a vehicle to the first waypoint of a mission: kilometres are usually the wrong mission or vehicle."""

from math import hypot
from typing import Final

from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.messages.motion import SiteSummary
from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.mapping.requested import requested
from gloc3_groundstation.station.snapshots import PlatformSnapshot

FAR_M: Final = 2000.0
"""From this distance on an operator confirms the upload."""
AWAY_M: Final = 1.0
"""A point of the path that is nearer to home is the take-off, not a waypoint."""


def first_waypoint_m(text: str, platform: PlatformSnapshot | None) -> float | None:
    """Horizontal distance from a vehicle's position to the first waypoint of a mission, m.

    Args:
        text: of the mission.
        platform: the vehicle.

    Returns:
        None where the position of either is not known, or the mission has no waypoint.
    """
    vehicle = platform.vehicle.value if platform is not None and platform.vehicle is not None else None
    if platform is None or vehicle is None or not vehicle.is_pose_valid:
        return None
    site = _site(platform, vehicle)
    found = requested(text, site)
    if found is None or not found.paths or (found.is_geo and site is None):
        return None
    is_around_vehicle = found.is_geo and platform.site is None
    bearing_deg = site.x_axis_bearing_deg if site is not None else 0.0
    position_m = (0.0, 0.0, 0.0) if is_around_vehicle else vehicle.position_m
    north_m, east_m, _ = LocalFrame(GeoPoint(0.0, 0.0, 0.0), bearing_deg).to_ned(position_m)
    home_north_m, home_east_m, _ = found.path_ned_m[0]
    for north, east, _ in found.path_ned_m:
        if hypot(north - home_north_m, east - home_east_m) > AWAY_M:
            return hypot(north - north_m, east - east_m)
    return None


def far_away(text: str, title: str, platform: PlatformSnapshot | None) -> str:
    """Says that the first waypoint of a mission is kilometres from the vehicle; empty where it is not, or not known."""
    distance_m = first_waypoint_m(text, platform)
    if platform is None or distance_m is None or distance_m < FAR_M:
        return ""
    return f"the first waypoint of {title!r} is {distance_m / 1000.0:.1f} km from {platform.name}"


def _site(platform: PlatformSnapshot, vehicle: VehicleSummary) -> SiteSummary | None:
    """The frame that the vehicle reports; else one around the vehicle itself, as far as it is known where that is."""
    if platform.site is not None:
        return platform.site.value
    return None if vehicle.geo is None else SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=vehicle.geo)
