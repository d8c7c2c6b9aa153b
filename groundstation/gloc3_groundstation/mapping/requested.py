"""A mission as drawn on the map: path of each action, numbered waypoints, the fence."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from math import dist
from typing import NamedTuple

import msgspec
import numpy as np

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint, LocalFrame, TangentPlane, Vector3
from gloc3.messages.motion import SiteSummary
from gloc3.mission.checking.estimate import estimate
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.fence import Fence
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.model import GEO
from gloc3.mission.model.structure import PartialOrder, structure_findings
from gloc3.mission.reading.mission_site import MissionSite
from gloc3.mission.reading.reader import MissionReferences, inspect_mission
from gloc3.terrain import Terrain

GROUND_POINTS = 400
"""Places along a path at which the ground is read, for its profile."""
SAME_M = 0.05
"""Points that are nearer to each other are one."""


class ActionPath(NamedTuple):
    """Path of one action."""

    target: str
    """`TASK.ACTION`."""
    points_ned_m: tuple[Vector3, ...]
    starts_m: float
    """Distance along the whole path at which it begins."""
    length_m: float


class Waypoint(NamedTuple):
    """A place that the mission names."""

    number: int
    """From 1, over the whole mission."""
    target: str
    position_ned_m: Vector3


class Requested(msgspec.Struct, frozen=True):
    """A mission's path and fence, in NED at the origin of the vehicle's frame."""

    name: str
    is_geo: bool
    paths: tuple[ActionPath, ...] = ()
    """In an order in which they can be flown."""
    waypoints: tuple[Waypoint, ...] = ()
    fence: Fence | None = None
    ground_m: tuple[tuple[float, float], ...] = ()
    """Distances along the whole path, and heights of the ground there above the origin; empty without terrain tiles."""

    @property
    def path_ned_m(self) -> tuple[Vector3, ...]:
        """The whole path."""
        points: list[Vector3] = []
        for path in self.paths:
            points += [point for point in path.points_ned_m if not points or dist(point, points[-1]) > SAME_M]
        return tuple(points)

    @property
    def length_m(self) -> float:
        """Of the whole path."""
        return self.paths[-1].starts_m + self.paths[-1].length_m if self.paths else 0.0


@lru_cache(maxsize=32)
def requested(text: str, site: SiteSummary | None, terrain: Terrain | None = None) -> Requested | None:
    """Parses a mission for drawing; None where it cannot be placed.

    Args:
        text: of the mission.
        site: the vehicle's frame, and home; None where they are unknown: x is then north, home the origin.
        terrain: heights of the ground; None without tiles: heights above it are then drawn as above home.
    """
    surroundings = references(site, terrain)
    frame_name = site.frame if site is not None else ""
    home_ned_m = (0.0, 0.0, 0.0)
    if site is not None and site.home_m is not None:
        home_ned_m = LocalFrame(GeoPoint(0.0, 0.0, 0.0), site.x_axis_bearing_deg).to_ned(site.home_m)
    try:
        reading = inspect_mission(text, "mission", surroundings)
    except InputError:
        return None
    mission = reading.mission
    if mission is None or (mission.frame != GEO and frame_name not in ("", mission.frame)):
        return None
    found = Requested(name=mission.name, is_geo=mission.frame == GEO, fence=mission.fence)
    if structure_findings(reading.tasks):
        return found
    figures = estimate(mission, PartialOrder.of(mission), home_ned_m, Budget(home_ned_m=home_ned_m), None)
    actions = mission.actions()
    routes: list[ActionPath] = []
    waypoints: list[Waypoint] = []
    along_m = 0.0
    for target, part in figures.actions.items():
        if not part.legs:
            continue
        points = [part.legs[0].start]
        points += [leg.end for leg in part.legs if dist(leg.end, points[-1]) > SAME_M]
        length_m = sum(dist(a, b) for a, b in pairwise(points))
        routes.append(ActionPath(target, tuple(points), along_m, length_m))
        along_m += length_m
        order = actions[target].order
        between = set(order.between) if isinstance(order, FollowWaypointsOrder) else ()
        for index, position in enumerate(getattr(order, "waypoints_ned_m", ())):
            if index not in between:
                waypoints.append(Waypoint(len(waypoints) + 1, target, position))
    found = msgspec.structs.replace(found, paths=tuple(routes), waypoints=tuple(waypoints))
    return msgspec.structs.replace(found, ground_m=_ground(found.path_ned_m, reading.site))


def references(site: SiteSummary | None, terrain: Terrain | None = None) -> MissionReferences:
    """What is known of a vehicle's place; heights above the ground are taken as above home where there are no tiles."""
    if site is None:
        return MissionReferences(terrain=terrain, is_ground_level=True)
    origin = GeoPoint(*site.origin_geo) if site.origin_geo is not None else None
    frame = LocalFrame(origin or GeoPoint(0.0, 0.0, 0.0), site.x_axis_bearing_deg)
    home_ned_m = frame.to_ned(site.home_m) if site.home_m is not None else (0.0, 0.0, 0.0)
    return MissionReferences(
        frames={site.frame: frame} if site.frame else None,
        origin=origin,
        home_altitude_m=origin.altitude_m - home_ned_m[2] if origin is not None else None,
        home=TangentPlane(origin).geo_from_ned(home_ned_m) if origin is not None else None,
        terrain=terrain,
        is_ground_level=True,
    )


def _ground(path_ned_m: Sequence[Vector3], site: MissionSite | None) -> tuple[tuple[float, float], ...]:
    """The ground below a path: distance along it, height above the origin of NED."""
    if site is None or site.ground is None or site.origin is None or len(path_ned_m) < 2:
        return ()
    points = np.array(path_ned_m)
    along_m = np.cumsum([0.0, *(dist(a, b) for a, b in pairwise(path_ned_m))])
    at_m = np.linspace(0.0, along_m[-1], GROUND_POINTS)
    rows = np.column_stack([np.interp(at_m, along_m, points[:, axis]) for axis in range(3)])
    clearances_m, _ = site.ground.clearances_m(TangentPlane(site.origin), [(n, e, d) for n, e, d in rows.tolist()])
    return tuple(zip(at_m.tolist(), (-rows[:, 2] - clearances_m).tolist(), strict=True))
