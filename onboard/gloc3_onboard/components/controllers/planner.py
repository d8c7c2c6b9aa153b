"""CC: plans the route of an action around everything that the map shows, and again whenever that changes."""

from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.loading import load_modules
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.standard_topics import POSE_LOST_S
from gloc3.messages.vehicle import MotionLimits, PlannedRoute, Pose, RouteWanted
from gloc3_onboard.algorithms.mapping.route_planner import RoutePlanner

WANTED_S = 3.0
"""A request that was repeated longer ago has ended."""


class PlannerSettings(Settings, frozen=True):
    """Settings of the planner."""

    keep_m: Annotated[float, Bounds(0.3, 10.0)] = 1.3
    """Distance from the vehicle's middle to everything that is known, in metres: somewhat more than the limiter's,
    so that this one has nothing to do on the way."""
    view_m: Annotated[float, Bounds(0.5, 30.0)] = 4.0
    """Distance from which a border of the known is looked at, in metres: less than the map's `range_m`."""


class PlannerController(Controller[PlannerSettings]):
    """Answers requests for routes, and reports another route when the map shows something in the last one."""

    loggable = ("routes", "reason")

    map = Input(OccupancyMap)
    pose = Input(Pose)
    limits = Input(MotionLimits)
    route_wanted = Input(RouteWanted)
    route = Output(PlannedRoute, frame="ned")

    def __init__(self) -> None:
        self.routes = 0
        self.reason = ""
        """Why there is no route; empty if there is one."""

    def initialize(self, settings: PlannerSettings) -> None:
        """Loads what the search needs."""
        self.settings = settings
        load_modules("scipy.ndimage", "scipy.sparse.csgraph")

    def start(self) -> None:
        """Knows no request."""
        self._planner = RoutePlanner(self.settings.keep_m, self.settings.view_m)
        self._request = ("", 0)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Plans for a new request, and checks the route against a new map."""
        wanted, known, pose = inbox.latest(self.route_wanted), inbox.latest(self.map), inbox.latest(self.pose)
        if wanted is None or not inbox.is_fresh(self.route_wanted, now_s, WANTED_S):
            return []
        if known is None or pose is None or not pose.payload.is_valid or now_s - pose.t_s > POSE_LOST_S:
            return []
        request = (wanted.payload.action_id, wanted.payload.request)
        if request == self._request and not inbox.new(self.map):
            return []
        self._request = request
        limits = inbox.latest(self.limits)
        found = self._planner.plan(
            wanted.payload, known.payload, pose.payload.position_ned_m, limits.payload if limits is not None else None
        )
        if found is None:
            return []
        self.routes += 1
        self.reason = "" if found.waypoints_ned_m else found.reason
        return [found]
