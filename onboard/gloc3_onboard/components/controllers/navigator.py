"""CC: flies the planner's routes: to a goal around everything that is known, and from frontier to frontier."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

from gloc3.component.action import ActionPerformer
from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, wrap_pi, yaw_of
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.standard_topics import POSE_LATE_S, TOPICS
from gloc3.messages.vehicle import DriverState, PlannedRoute, Pose, RouteWanted, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.exploring import ExploreOrder
from gloc3.mission.model.states import ActionState
from gloc3.mission.model.waypoint_options import refuse_unkept
from gloc3_onboard.algorithms.paths.path_follower import PathFollower
from gloc3_onboard.algorithms.paths.path_reference import PathReference

REQUEST_S = 1.0
"""The request is repeated this often."""
STEP_S = 0.1
MOST_STUCK = 3
"""So often another route is asked for, one after the other, before the action fails."""
ACCEPTANCE_M = 0.25
"""A viewpoint is reached within this distance."""


class NavigatorSettings(Settings, frozen=True):
    """Settings of the navigator."""

    acceleration_m_s2: Annotated[float, Bounds(0.1, 20.0)] = 2.0
    """Acceleration along the route, in m/s²."""
    climb_m_s: Annotated[float, Bounds(0.1, 20.0)] = 1.0
    """Largest vertical speed; steep legs are flown slower."""
    yaw_rate_rad_s: Annotated[float, Bounds(0.05, 6.0)] = 1.0
    """How fast the heading turns."""
    patience_s: Annotated[float, Bounds(0.5, 600.0)] = 8.0
    """So long it waits in a hover for a route, in seconds, before the action fails with the reason why there is none."""
    map_limit_s: Annotated[float, Bounds(0.5, 70.0)] = 2.5
    """Age of the last scan in the map above which it hovers, in seconds: more than the map's `period_s` and
    `scan_period_s` together."""
    look_s: Annotated[float, Bounds(0.0, 30.0)] = 1.5
    """Time to look from a viewpoint, in seconds, at least; until the map shows what has been seen from there."""
    stuck_s: Annotated[float, Bounds(1.0, 600.0)] = 10.0
    """Time without progress on a route after which another one is asked for, in seconds."""
    follow_s: Annotated[float, Bounds(1.0, 600.0)] = 30.0
    """Longest wait for the autopilot to follow the setpoints, before the action fails."""
    at_rest_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.2
    """Speed below which the vehicle has arrived."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""


class NavigatorController(ActionPerformer, Controller[NavigatorSettings]):
    """Asks the planner for routes and streams setpoints along them; without a route it keeps its place."""

    loggable = ("request", "route_number", "cross_track_m")
    performs: ClassVar = {"find_way": FollowWaypointsOrder, "explore": ExploreOrder}
    keeps: ClassVar[frozenset[str]] = frozenset({"acceptance_m", "plan"})
    chooses_heading: ClassVar[bool] = False

    pose = Input(Pose)
    driver = Input(DriverState)
    map = Input(OccupancyMap)
    route = Input(PlannedRoute)
    setpoint_wanted = Output(Setpoint, frame="ned")
    route_wanted = Output(RouteWanted, frame="ned")

    def __init__(self) -> None:
        self.request = self.route_number = 0
        self.cross_track_m = 0.0
        self._order: FollowWaypointsOrder | ExploreOrder | None = None
        self._pose: Pose | None = None
        self._map_s = -math.inf
        """Time of the last scan in the map."""
        self._is_blind = False
        """Whether that is too long ago."""
        self._reference: PathReference | None = None
        self._place_ned_m: Vector3 = (0.0, 0.0, 0.0)
        """The last target, to keep while there is no route."""
        self._yaw_rad = 0.0
        self._last_s = self._requested_s = -math.inf
        self._waits_from_s = 0.0
        """Since when there is no route."""
        self._arrived_s: float | None = None
        self._reason = ""
        """Why there is no route."""
        self._stuck = 0
        self._progress = self._length_m = self._flown_s = 0.0

    def stop(self) -> None:
        """Drops the action under way."""
        self.drop_action()
        self._order = None

    def begin_action(self, capability: str, arguments: FollowWaypointsOrder | ExploreOrder, now_s: float) -> None:
        """Asks for a route from the vehicle's position."""
        if self._pose is None or not self._pose.is_valid:
            raise Refused("there is no valid pose")
        if math.isinf(self._map_s):
            raise Refused("there is no map to plan in")
        if now_s - self._map_s > TOPICS["map"].silent_s:
            raise Refused(f"the map has no scan of the last {TOPICS['map'].silent_s:g} s")
        if isinstance(arguments, FollowWaypointsOrder):
            refuse_unkept(arguments, self.keeps, "a planned way")
            if len(arguments.waypoints_ned_m) != 1:
                raise Refused("a way is planned to one place at a time")
            if arguments.heading.mode != "along":
                raise Refused(f"a planned way cannot choose its heading: heading {arguments.heading.mode}")
        self._order = arguments
        self.request = self.route_number = self._stuck = 0
        self._progress = self._length_m = self._flown_s = 0.0
        if isinstance(arguments, FollowWaypointsOrder):
            self._length_m = math.dist(self._pose.position_ned_m, arguments.waypoints_ned_m[-1])
        self._start_over(self._pose, now_s)

    def resume_action(self, now_s: float) -> None:
        """Asks for a route from where the vehicle is now."""
        if self._pose is not None:
            self._start_over(self._pose, now_s)

    def _start_over(self, pose: Pose, now_s: float) -> None:
        self._yaw_rad, self._place_ned_m, self._last_s = yaw_of(pose.ned_from_frd), pose.position_ned_m, now_s
        self._is_blind = False
        self._request_route(now_s)

    def end_action(self, now_s: float) -> None:
        """Drops the route."""
        self._order = self._reference = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Advances the target on the route, and repeats the request."""
        latest = inbox.latest(self.pose)
        is_fresh = inbox.is_fresh(self.pose, now_s, self.settings.pose_limit_s)
        self._pose = latest.payload if latest is not None and is_fresh else None
        if (known := inbox.latest(self.map)) is not None:
            self._map_s = known.t_s
        results: list[Result] = []
        order, pose = self._order, self._pose
        if self.is_running and order is not None:
            self._flown_s += now_s - self._last_s
            self._watch_map(now_s)
            for route in inbox.new(self.route) if not self._is_blind else ():
                if route.payload.action_id == self.action_id and route.payload.request == self.request:
                    self._take(route.payload, order, now_s)
            if self.is_running and pose is not None and pose.is_valid:
                results.append(self._follow(order, pose, inbox.latest(self.driver), now_s))
            if self.is_running and now_s - self._requested_s >= REQUEST_S:
                self._requested_s = now_s
                results.append(self._wanted(order))
            self._last_s = now_s
        return [*results, *self.action_reports(now_s)]

    # --- routes ---

    def _watch_map(self, now_s: float) -> None:
        """Drops the route while no scan comes into the map, and asks for another one afterwards."""
        limit_s, was_blind = self.settings.map_limit_s, self._is_blind
        self._is_blind = now_s - self._map_s > limit_s
        if self._is_blind:
            if self._reference is not None:
                self._waits_from_s = now_s
            self._reference = self._arrived_s = None
            self._reason = f"the map has no scan of the last {limit_s:g} s"
        elif was_blind:
            self._request_route(now_s)

    def _request_route(self, now_s: float) -> None:
        """Asks for another route, and keeps the place until it comes."""
        self.request += 1
        self._reference, self._arrived_s = None, None
        self._requested_s, self._waits_from_s = -math.inf, now_s
        self._reason = ""

    def _wanted(self, order: FollowWaypointsOrder | ExploreOrder) -> RouteWanted:
        if isinstance(order, ExploreOrder):
            return RouteWanted(
                action_id=self.action_id, request=self.request, down_m=order.down_m, area_ne_m=order.area_ne_m
            )
        north, east, down = order.waypoints_ned_m[-1]
        return RouteWanted(action_id=self.action_id, request=self.request, down_m=down, goal_ne_m=(north, east))

    def _take(self, route: PlannedRoute, order: FollowWaypointsOrder | ExploreOrder, now_s: float) -> None:
        """Begins a route, stops without one, or ends the action."""
        self.route_number, self._reason = route.number, route.reason
        if route.is_complete:
            self.advance(now_s, 1.0, ActionState.DONE, route.reason)
            return
        self._arrived_s = None
        if not route.waypoints_ned_m:
            self._waits_from_s = self._waits_from_s if self._reference is None else now_s
            self._reference = None
            return
        follower = PathFollower(
            self._place_ned_m,
            route.waypoints_ned_m,
            order.speed_m_s,
            self.settings.acceleration_m_s2,
            climb_m_s=self.settings.climb_m_s,
            acceptance_m=_acceptance_m(order),
        )
        self._reference = PathReference(follower, now_s, self.settings.at_rest_m_s)
        if isinstance(order, ExploreOrder):
            self.advance(now_s, route.progress)

    # --- setpoints ---

    def _follow(
        self,
        order: FollowWaypointsOrder | ExploreOrder,
        pose: Pose,
        driver: Envelope[DriverState] | None,
        now_s: float,
    ) -> Setpoint:
        action_id, reference, velocity = self.action_id, self._reference, (0.0, 0.0, 0.0)
        if isinstance(order, ExploreOrder) and self._flown_s > order.duration_s:
            self.advance(now_s, 1.0, ActionState.DONE, f"its {order.duration_s:g} s are over")
        elif reference is not None and self._arrived_s is None:
            target = reference.advance(pose, driver, now_s)
            self._place_ned_m, velocity = target.position_ned_m, target.velocity_ned_m_s
            if target.bearing_rad is not None:
                self._turn(target.bearing_rad, now_s)
            self._judge(order, reference, pose, now_s)
        elif self._arrived_s is not None:
            if now_s - self._arrived_s >= self.settings.look_s and self._map_s >= self._arrived_s:
                self._request_route(now_s)
        elif now_s - self._waits_from_s > self.settings.patience_s:
            reason = self._reason or "the planner does not answer"
            self.advance(now_s, self._progress, ActionState.FAILED, reason)
        self.cross_track_m = math.dist(self._place_ned_m, pose.position_ned_m)
        return Setpoint(
            action_id=action_id, position_ned_m=self._place_ned_m, velocity_ned_m_s=velocity, yaw_rad=self._yaw_rad
        )

    def _judge(
        self, order: FollowWaypointsOrder | ExploreOrder, reference: PathReference, pose: Pose, now_s: float
    ) -> None:
        """Whether it has arrived, or is stuck."""
        problem = reference.problem(self.settings.stuck_s, self.settings.follow_s)
        if isinstance(order, FollowWaypointsOrder):
            left_m = math.dist(pose.position_ned_m, order.waypoints_ned_m[-1])
            self._progress = max(self._progress, 1.0 - left_m / self._length_m if self._length_m else 0.0)
        if reference.is_there(_acceptance_m(order)):
            self._stuck = 0
            if isinstance(order, ExploreOrder):
                self._arrived_s = now_s
            else:
                self.advance(now_s, 1.0, ActionState.DONE)
        elif problem and reference.follower.waited_s > self.settings.stuck_s and self._stuck < MOST_STUCK:
            self._stuck += 1
            self._place_ned_m = pose.position_ned_m
            self._request_route(now_s)
        elif problem:
            self.advance(now_s, self._progress, ActionState.FAILED, f"{problem} ({self.cross_track_m:.2f} m away)")
        elif isinstance(order, FollowWaypointsOrder):
            self.advance(now_s, self._progress)

    def _turn(self, wanted_rad: float, now_s: float) -> None:
        step = self.settings.yaw_rate_rad_s * min(now_s - self._last_s, STEP_S)
        self._yaw_rad = wrap_pi(self._yaw_rad + min(max(wrap_pi(wanted_rad - self._yaw_rad), -step), step))


def _acceptance_m(order: FollowWaypointsOrder | ExploreOrder) -> float:
    return order.acceptance_m if isinstance(order, FollowWaypointsOrder) else ACCEPTANCE_M
