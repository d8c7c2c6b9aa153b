"""The plane of the map, and where each vehicle's own frame lies on it.

The map is a plane at the origin of the selected vehicle's frame, in metres north and east of it. Other vehicles are
placed by their frame's geographic origin, or by its name where that is unknown.
"""

from math import cos, hypot, radians, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3.messages.motion import SiteSummary
from gloc3.mission.model.fence import Area
from gloc3_groundstation.station.snapshots import PlatformSnapshot

Plane = NDArray[np.float64]
"""Rows of metres north and east on the map."""

CIRCLE: Final = np.linspace(0.0, 2.0 * np.pi, 73)
"""Angles of a circle that is drawn, rad."""
FARTHEST_M = 100_000.0
"""Distance beyond which a vehicle is not on the same map, m: the map is flat, the Earth is not."""


class MapPlacement(NamedTuple):
    """Placement of a vehicle's frame (x, y, height) on the map."""

    cosine: float = 1.0
    """Of the bearing of x."""
    sine: float = 0.0
    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float = 0.0

    def plane(self, xy_m: Plane) -> Plane:
        """Rows of x and y as rows of north and east."""
        x, y = xy_m[:, 0], xy_m[:, 1]
        return np.column_stack(
            (x * self.cosine + y * self.sine + self.north_m, x * self.sine - y * self.cosine + self.east_m)
        )

    def point(self, position_m: Vector3) -> Vector3:
        """x, y, height as north, east, height."""
        x, y, height = position_m
        return (
            x * self.cosine + y * self.sine + self.north_m,
            x * self.sine - y * self.cosine + self.east_m,
            height + self.up_m,
        )

    def local(self, north_m: float, east_m: float) -> tuple[float, float]:
        """X and y of a position on the map."""
        north, east = north_m - self.north_m, east_m - self.east_m
        return north * self.cosine + east * self.sine, north * self.sine - east * self.cosine

    def plane_of_ne(self, points_ne_m: Plane) -> Plane:
        """Rows of metres north and east of the frame's own origin as rows of north and east on the map."""
        moved: Plane = points_ne_m + np.array((self.north_m, self.east_m))
        return moved

    def from_ned(self, points_ned_m: Plane) -> Plane:
        """Rows of NED at the frame's own origin as rows of north and east on the map."""
        return self.plane_of_ne(points_ned_m[:, :2])


class Ground:
    """The map's plane for a vehicle in view."""

    def __init__(self, platform: PlatformSnapshot | None) -> None:
        site = _site(platform)
        self.frame = site.frame if site is not None else _frame_name(platform)
        """The name of the frame of the vehicle in view; empty without one."""
        self.has_north = site is not None
        """Whether the direction of north is known; otherwise the frame's x axis is used."""
        self.site = site
        self.origin = _origin(platform, site)
        """Of the plane on Earth; None where it is unknown."""
        self.plane = TangentPlane(self.origin) if self.origin is not None else None
        self._name = platform.name if platform is not None else ""

    def __repr__(self) -> str:
        return f"Ground({self._name!r}, {self.frame!r}, {self.origin!r})"

    def place(self, platform: PlatformSnapshot) -> MapPlacement | None:
        """Where a vehicle's frame lies; None where it is not known, or far away."""
        site = _site(platform)
        bearing_rad = radians(site.x_axis_bearing_deg) if site is not None else 0.0
        turned = MapPlacement(cos(bearing_rad), sin(bearing_rad))
        if platform.name == self._name:
            return turned
        origin = _origin(platform, site)
        if self.plane is not None and origin is not None:
            north, east, down = self.plane.ned_from_geo(*origin)
            return turned._replace(north_m=north, east_m=east, up_m=-down) if hypot(north, east) < FARTHEST_M else None
        frame = site.frame if site is not None else _frame_name(platform)
        return turned if frame and frame == self.frame else None

    def geo(self, north_m: float, east_m: float) -> GeoPoint | None:
        """Geographic position of a point on the map."""
        return self.plane.geo_from_ned((north_m, east_m, 0.0)) if self.plane is not None else None


def _site(platform: PlatformSnapshot | None) -> SiteSummary | None:
    return platform.site.value if platform is not None and platform.site is not None else None


def _frame_name(platform: PlatformSnapshot | None) -> str:
    return platform.vehicle.value.frame if platform is not None and platform.vehicle is not None else ""


def _origin(platform: PlatformSnapshot | None, site: SiteSummary | None) -> GeoPoint | None:
    """Geographic origin of a vehicle's frame: as reported, or from its position in both frames."""
    if site is not None and site.origin_geo is not None:
        return GeoPoint(*site.origin_geo)
    vehicle = platform.vehicle.value if platform is not None and platform.vehicle is not None else None
    if vehicle is None or vehicle.geo is None or site is not None:
        return None
    x, y, height = vehicle.position_m
    return TangentPlane(GeoPoint(*vehicle.geo)).geo_from_ned((-x, y, height))


def position_of(platform: PlatformSnapshot) -> tuple[float, float, float] | None:
    """Position of a vehicle in its own frame, from the newer of its two reports; None where it is unknown."""
    motion, vehicle = platform.motion, platform.vehicle
    if motion is not None and (vehicle is None or motion.received_s >= vehicle.received_s - 1.0):
        x, y, height = motion.value.position_cm
        return (x / 100.0, y / 100.0, height / 100.0) if motion.value.is_pose_valid else None
    if vehicle is None or not vehicle.value.is_pose_valid:
        return None
    return vehicle.value.position_m


def outline(area: Area) -> Plane:
    """The edge of an area, closed: rows of metres north and east."""
    if area.polygon_ne_m:
        return np.array((*area.polygon_ne_m, area.polygon_ne_m[0]))
    return np.column_stack((np.cos(CIRCLE), np.sin(CIRCLE))) * area.radius_m + area.center_ne_m


def heading_deg_of(platform: PlatformSnapshot) -> float:
    """Heading of a vehicle, clockwise from north, degrees; north where it is not known."""
    if platform.motion is not None:
        return platform.motion.value.attitude_cdeg[2] / 100.0
    return max(0.0, platform.vehicle.value.heading_deg) if platform.vehicle is not None else 0.0
