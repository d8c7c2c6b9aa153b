"""Plans the route of an action: to a goal, or from frontier to frontier; again whenever the map shows something in it."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec.structs import replace

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.vehicle import MotionLimits, PlannedRoute, RouteWanted
from gloc3.mission.model.fence import Area
from gloc3_onboard.algorithms.mapping.frontiers import Frontiers
from gloc3_onboard.algorithms.mapping.known_space import KnownSpace, Mask, SpaceLimits, heights_of
from gloc3_onboard.algorithms.mapping.shortest_paths import Place, ShortestPaths

STEP: Final = 2
"""So many cells of the map, on each side, are one cell of the search."""


class RoutePlanner:
    """Keeps one route up to date.

    Args:
        keep_m: distance to keep from everything that is known.
        view_m: distance from which a frontier is looked at.
    """

    def __init__(self, keep_m: float, view_m: float) -> None:
        self._keep_m, self._view_m = keep_m, view_m
        self._wanted: RouteWanted | None = None
        self._path: list[Vector3] = []
        """From where the vehicle was to the end of the route; empty without one."""
        self._number, self._reason = 0, ""
        self._frontier: Place | None = None
        """What the vehicle is on its way to look at."""
        self._given_up: list[Place] = []

    def plan(
        self, wanted: RouteWanted, known: OccupancyMap, at_ned_m: Vector3, limits: MotionLimits | None
    ) -> PlannedRoute | None:
        """The route for a request; None where the one that was returned last still holds."""
        before = self._wanted
        is_other = before is None or before.action_id != wanted.action_id
        is_new = is_other or (before is not None and before.request != wanted.request)
        if is_other:
            self._number, self._frontier, self._given_up, self._path = 0, None, [], []
        self._wanted = wanted
        try:
            route = self._planned(wanted, known, at_ned_m, limits, is_new=is_new)
        except Refused as refusal:
            route = PlannedRoute(action_id=wanted.action_id, request=wanted.request, reason=str(refusal))
            if not is_new and not self._path and self._reason == route.reason:
                return None
        if route is None:
            return None
        self._number += 1
        self._path = [at_ned_m, *route.waypoints_ned_m] if route.waypoints_ned_m else []
        self._reason = route.reason
        return replace(route, number=self._number)

    def _planned(
        self, wanted: RouteWanted, known: OccupancyMap, at: Vector3, limits: MotionLimits | None, *, is_new: bool
    ) -> PlannedRoute | None:
        fence = limits.fence if limits is not None else None
        places = [at[:2], *([wanted.goal_ne_m] if wanted.goal_ne_m is not None else []), *wanted.area_ne_m]
        if wanted.goal_ne_m is None and fence is not None and fence.area is not None:
            places += fence.area.polygon_ne_m
        margin_m = limits.fence_margin_m if limits is not None else 0.0
        space = KnownSpace(
            known, STEP, heights_of(at, wanted.down_m), SpaceLimits(self._keep_m, fence, margin_m), places
        )
        if wanted.goal_ne_m is not None:
            if not is_new and self._holds(space, at):
                return None
            return self._to_goal(wanted, wanted.goal_ne_m, space, at)
        area = self._area(wanted, space, limits)
        frontiers = Frontiers(space, area)
        if self._frontier is not None and is_new and frontiers.is_there(self._frontier):
            self._given_up.append(self._frontier)
        is_seen = self._frontier is None or not frontiers.is_there(self._frontier)
        if not is_new and not is_seen and self._holds(space, at):
            return None
        return self._to_frontier(wanted, space, frontiers, area, at)

    def _to_goal(self, wanted: RouteWanted, goal: Place, space: KnownSpace, at: Vector3) -> PlannedRoute:
        cell = space.cell(goal)
        if not space.allowed[cell]:
            raise Refused("the goal is outside the fence or in its margin")
        if not space.passable[cell]:
            near_m = max(0.0, float(space.clearance_m[cell]))
            raise Refused(f"the goal is {near_m:.1f} m from something, and {self._keep_m:g} m are kept")
        try:
            corners = ShortestPaths(space, at).to(cell)
        except Refused:
            raise Refused(f"no way leads to the goal that keeps {self._keep_m:g} m from everything") from None
        return _route(wanted, [*corners[:-1], goal])

    def _to_frontier(
        self, wanted: RouteWanted, space: KnownSpace, frontiers: Frontiers, area: Mask, at: Vector3
    ) -> PlannedRoute:
        if not (space.free & area).any():
            raise Refused("the map shows nothing free in the area yet")
        known = (space.free | space.occupied) & area
        share = float(np.count_nonzero(known)) / float(np.count_nonzero(area))
        view = frontiers.nearest_view(ShortestPaths(space, at, is_through_unknown=False), self._view_m, self._given_up)
        if view is None:
            self._frontier = None
            left = len(frontiers.places)
            hidden = f"; {left} place{'s' if left > 1 else ''} cannot be seen from where it may fly" if left else ""
            reason = f"{share:.0%} of the area is known{hidden}"
            return PlannedRoute(
                action_id=wanted.action_id, request=wanted.request, is_complete=True, progress=1.0, reason=reason
            )
        self._frontier = view.frontier_ne_m
        return _route(wanted, view.corners_ne_m, progress=share)

    def _area(self, wanted: RouteWanted, space: KnownSpace, limits: MotionLimits | None) -> Mask:
        if wanted.area_ne_m:
            return space.within(Area(polygon_ne_m=wanted.area_ne_m)) & space.inside
        if limits is None or limits.fence is None or limits.fence.area is None:
            raise Refused("neither an area to explore nor a fence is given")
        return space.inside

    def _holds(self, space: KnownSpace, at: Vector3) -> bool:
        """Whether the rest of the route is still clear; a cell less of clearance is no reason for another one."""
        away = [_from_leg_m(at, start, end) for start, end in pairwise(self._path)]
        if not away:
            return False
        on_leg = min(range(len(away)), key=lambda index: (round(away[index], 2), -index))
        clear = space.allowed & (space.clearance_m >= self._keep_m - space.cell_m)
        legs = list(pairwise([at, *self._path[on_leg + 1 :]]))
        return all(bool(clear[space.line(*leg)].all()) for leg in (legs if clear[space.cell(at)] else legs[1:]))


def _from_leg_m(at: Vector3, start: Vector3, end: Vector3) -> float:
    north, east = end[0] - start[0], end[1] - start[1]
    square = north * north + east * east
    along = 0.0 if square <= 0.0 else ((at[0] - start[0]) * north + (at[1] - start[1]) * east) / square
    share = min(max(along, 0.0), 1.0)
    return math.hypot(at[0] - start[0] - share * north, at[1] - start[1] - share * east)


def _route(wanted: RouteWanted, corners: Sequence[Place], progress: float = 0.0) -> PlannedRoute:
    waypoints = [(north, east, wanted.down_m) for north, east in corners]
    return PlannedRoute(
        action_id=wanted.action_id, request=wanted.request, waypoints_ned_m=waypoints, progress=progress
    )
