"""CC: attains a list of waypoints (paper §VI), and returns home."""

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec.structs import replace

from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, wrap_pi, yaw_of
from gloc3.messages.neighbours import SeparationState
from gloc3.messages.standard_topics import POSE_LATE_S
from gloc3.messages.vehicle import DriverState, HeightAboveGround, ObstacleScan, Pose, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder, ReturnHome
from gloc3.mission.model.states import ActionState
from gloc3.mission.model.waypoint_options import refuse_unkept
from gloc3_onboard.algorithms.mapping.obstacle_field import ObstacleField
from gloc3_onboard.algorithms.paths.floor_clearance import FloorClearance
from gloc3_onboard.algorithms.paths.path_follower import PathFollower, PathTarget
from gloc3_onboard.algorithms.paths.path_reference import PathReference
from gloc3_onboard.algorithms.paths.wall_distance import WallDistance, wall_ahead
from gloc3_onboard.components.controllers.waypoint_performer import WaypointPerformer

DETOUR_M = 2.0
"""So much farther ahead the point that is followed may be while the vehicle goes around something."""
AHEAD_M = 1.5
NARROW_M = 0.1
"""Shortfall in clearance that is accepted, as by the limiter, m."""
SETTLED_S = 1.0
"""The height over the floor is settled when it needs a correction for no longer than this, s."""
LOOK_AT_M = 0.2
"""Distance to the look-at point below which the vehicle keeps its heading, m."""


class WaypointsSettings(Settings, frozen=True):
    """Settings of the waypoint controller."""

    acceleration_m_s2: Annotated[float, Bounds(0.1, 20.0)] = 2.0
    """Acceleration along the path, in m/s²."""
    climb_m_s: Annotated[float, Bounds(0.1, 20.0)] = 1.0
    """Largest vertical speed; steep legs are flown slower."""
    yaw_rate_rad_s: Annotated[float, Bounds(0.05, 6.0)] = 1.0
    """How fast the heading turns."""
    return_speed_m_s: Annotated[float, Bounds(0.1, 50.0)] = 1.5
    """Speed of a return home that names none."""
    settle_s: Annotated[float, Bounds(0.0, 60.0)] = 10.0
    """Longest wait for the vehicle to come to a waypoint, before the action fails."""
    detour_s: Annotated[float, Bounds(0.0, 600.0)] = 15.0
    """Greatest extra waiting time for an obstacle in the path, in seconds."""
    give_way_s: Annotated[float, Bounds(0.0, 3600.0)] = 60.0
    """Greatest extra waiting time while the limiter keeps the vehicle away from another one, in seconds."""
    follow_s: Annotated[float, Bounds(1.0, 600.0)] = 30.0
    """Longest wait for the autopilot to follow the setpoints, before the action fails."""
    at_rest_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.2
    """Speed below which the action is done at the last waypoint, so that the next one starts there; in a wind that
    never lets the vehicle rest, it is done after some seconds."""
    least_acceptance_m: Annotated[float, Bounds(0.0, 50.0)] = 0.0
    """Smallest acceptance radius of waypoints, in metres, whatever the mission asks: the accuracy of the vehicle's
    position (about 1 m with plain satellites)."""
    comes_within_m: Annotated[float, Bounds(0.0, 500.0)] = 0.0
    """So near a vehicle that cannot stop comes to a place, in metres: more than the radius of a plane's circles."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""
    keep_m: Annotated[float, Bounds(0.3, 10.0)] = 1.1
    """Objects closer to the path than this are avoided, in metres; as in the limiter, which does it."""
    obstacles_limit_s: Annotated[float, Bounds(0.1, 10.0)] = 1.0
    """Obstacles that were seen longer ago do not count."""
    wall_s: Annotated[float, Bounds(0.5, 600.0)] = 5.0
    """Longest flight without sight of the wall that a distance is to be kept from, before the action fails."""
    floor_s: Annotated[float, Bounds(0.5, 600.0)] = 10.0
    """Longest time without an echo of the floor while keeping a height over it, in seconds."""
    range_limit_s: Annotated[float, Bounds(0.1, 10.0)] = 0.5
    """Age above which a range is ignored, in seconds."""


class WaypointsController(WaypointPerformer, Controller[WaypointsSettings]):
    """Streams setpoints along the waypoints of an action; without a valid pose it streams nothing."""

    loggable = ("travelled_m", "waypoint", "cross_track_m")
    keeps = frozenset({"acceptance_m", "hold_s", "altitude_m", "wall_distance_m"})

    obstacles = Input(ObstacleScan)
    separation = Input(SeparationState)
    height = Input(HeightAboveGround)

    def __init__(self) -> None:
        self.travelled_m = 0.0
        self.waypoint = 0
        self.cross_track_m = 0.0
        self._reference: PathReference | None = None
        self._wall: WallDistance | None = None
        self._floor: FloorClearance | None = None
        self._range_m: float | None = None
        """Reading of the downward range finder; None without an echo."""
        self._points: list[tuple[float, float]] | None = None
        """Obstacle points; None without a scanner."""
        self._is_blocking, self._hindered_s = False, 0.0
        self._kept_from, self._gave_way_s = "", 0.0
        self._passed = 0
        """Waypoints that an earlier attempt had passed."""
        self._yaw_rad = 0.0
        self._last_s = 0.0

    def stop(self) -> None:
        """Drops the action under way."""
        self.drop_action()
        self._reference = None

    def begin_action(self, capability: str, arguments: FollowWaypointsOrder | ReturnHome, now_s: float) -> None:
        """Plans the path from the vehicle's position through the waypoints that no earlier attempt has passed."""
        pose, order = self.wanted(arguments)
        refuse_unkept(order, self.keeps, "this vehicle")
        least_m = max(self.settings.least_acceptance_m, self.settings.comes_within_m)
        order = replace(order, acceptance_m=max(order.acceptance_m, least_m))
        if order.wall_distance_m is not None and self._points is None:
            raise Refused("no sensor sees the wall to keep the distance from: a laser scanner reports no obstacles")
        self._floor = None
        if order.altitude_m is not None:
            # Its heights are the floor's: the way is laid level, where the vehicle is if the floor is seen from there.
            down_m = order.waypoints_ned_m[0][2] if self._range_m is None else pose.position_ned_m[2]
            self._floor = FloorClearance(order.altitude_m, down_m, self.settings.climb_m_s)
            order = replace(order, waypoints_ned_m=tuple((n, e, down_m) for n, e, _ in order.waypoints_ned_m))
        self._order = order
        self._is_blocking, self._hindered_s = False, 0.0
        self._kept_from, self._gave_way_s = "", 0.0
        self._passed = self.passed(order, pose.position_ned_m)
        self._yaw_rad = yaw_of(pose.ned_from_frd)
        self._last_s = now_s
        follower = PathFollower(
            pose.position_ned_m,
            order.waypoints_ned_m[self._passed :],
            order.speed_m_s,
            self.settings.acceleration_m_s2,
            order.rest_s,
            climb_m_s=self.settings.climb_m_s,
            acceptance_m=order.acceptance_m,
        )
        self._reference = PathReference(follower, now_s, self.settings.at_rest_m_s)
        self._wall = None if order.wall_distance_m is None else WallDistance(order.wall_distance_m)

    def path_home(self, arguments: ReturnHome, home_ned_m: Vector3, here_ned_m: Vector3) -> FollowWaypointsOrder:
        """To the height, then straight home, with the heading that there is."""
        home, (north, east, down) = home_ned_m, here_ned_m
        height_down = down if arguments.height_m is None else home[2] - arguments.height_m
        return FollowWaypointsOrder(
            waypoints_ned_m=((north, east, height_down), (home[0], home[1], height_down)),
            speed_m_s=arguments.speed_m_s or self.settings.return_speed_m_s,
            heading=HeadingOrder(mode="hold"),
        )

    def end_action(self, now_s: float) -> None:
        """Drops the path."""
        self._reference = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Advances the target and publishes its setpoint."""
        self.update_pose(inbox, now_s, self.settings.pose_limit_s)
        scan = inbox.latest(self.obstacles)
        is_seen = scan is not None and inbox.is_fresh(self.obstacles, now_s, self.settings.obstacles_limit_s)
        self._points = scan.payload.points_ne_m if scan is not None and is_seen and scan.payload.is_valid else None
        height = inbox.latest(self.height)
        is_in_contact = height is not None and inbox.is_fresh(self.height, now_s, self.settings.range_limit_s)
        self._range_m = (
            height.payload.height_m if height is not None and is_in_contact and height.payload.is_valid else None
        )
        separation = inbox.latest(self.separation)
        self._kept_from = separation.payload.name if separation is not None else ""
        results: list[Result] = []
        if self.is_running and self._reference is not None and self._order is not None:
            if self._pose is not None and self._pose.is_valid:
                driver = inbox.latest(self.driver)
                results.append(self._follow(self._reference, self._order, self._pose, driver, now_s))
            self._last_s = now_s
        return [*results, *self.action_reports(now_s)]

    def _follow(
        self,
        reference: PathReference,
        order: FollowWaypointsOrder,
        pose: Pose,
        driver: Envelope[DriverState] | None,
        now_s: float,
    ) -> Setpoint:
        action_id, follower = self.action_id, reference.follower
        target = self._target(reference, pose, driver, now_s)
        self.travelled_m, self.waypoint = follower.travelled_m, self._passed + follower.waypoint
        self.cross_track_m = math.dist(target.position_ned_m, pose.position_ned_m)
        count = len(order.waypoints_ned_m)
        progress = (self._passed + follower.progress * (count - self._passed)) / count
        self._hindered_s += (now_s - self._last_s) * self._is_blocking
        self._gave_way_s += (now_s - self._last_s) * bool(self._kept_from)
        settle_s = self.settings.settle_s + min(self._hindered_s, self.settings.detour_s)
        settle_s += min(self._gave_way_s, self.settings.give_way_s)
        left_s = 0.0 if self._floor is None else self._floor.left_s
        problem = reference.problem(settle_s + left_s, self.settings.follow_s)
        if self._wall is not None and self._wall.blind_s > self.settings.wall_s:
            problem = "the wall to keep the distance from is out of sight"
        if self._floor is not None and self._floor.blind_s > self.settings.floor_s:
            problem = "the floor to keep the height over is out of sight"
        self._turn(order.heading, target.bearing_rad, pose, now_s - self._last_s)
        if problem:
            why = ", an obstacle blocks the path" if self._is_blocking else ""
            why += f", {self._kept_from} is in the way" if self._kept_from else ""
            self.advance(now_s, progress, ActionState.FAILED, f"{problem} ({self.cross_track_m:.2f} m away{why})")
        else:
            is_there = reference.is_there(order.acceptance_m) and left_s < SETTLED_S
            state = ActionState.DONE if is_there else ActionState.RUNNING
            self.advance(now_s, progress, state, achieved=int(progress * count + 1e-6), is_blocked=self._is_blocking)
        return Setpoint(
            action_id=action_id,
            position_ned_m=target.position_ned_m,
            velocity_ned_m_s=target.velocity_ned_m_s,
            yaw_rad=self._yaw_rad,
        )

    def _target(
        self, reference: PathReference, pose: Pose, driver: Envelope[DriverState] | None, now_s: float
    ) -> PathTarget:
        """The vehicle's target now: on its path, or at the demanded distance from wall and floor."""
        at, wall, floor, points = pose.position_ned_m, self._wall, self._floor, self._points or []
        duration_s = min(now_s - self._last_s, 0.1)
        if floor is not None:
            floor.update(self._range_m, pose.ned_from_frd, at, duration_s)
            pose = replace(pose, position_ned_m=floor.unmoved(at))
        if wall is not None:
            pose = replace(pose, position_ned_m=wall.unmoved(pose.position_ned_m))
        target = reference.advance(pose, driver, now_s, is_waiting=floor is not None and floor.is_too_near)
        if wall is not None:
            seen = wall_ahead(points, at, yaw_of(pose.ned_from_frd))
            wall.update(seen, at, target.position_ned_m, duration_s)
            target = target._replace(position_ned_m=wall.moved(target.position_ned_m))
        if floor is not None:
            target = target._replace(position_ned_m=floor.moved(target.position_ned_m))
        self._is_blocking = self._is_blocked(at, target, points)
        reference.follower.slack_m = self.settings.comes_within_m + (DETOUR_M if self._is_blocking else 0.0)
        return target

    def _is_blocked(self, at: Vector3, target: PathTarget, points: list[tuple[float, float]]) -> bool:
        """Whether an obstacle is too close to the path to the target or to the next leg."""
        if not points:
            return False
        speed = math.hypot(*target.velocity_ned_m_s[:2])
        share = AHEAD_M / speed if speed > 0.0 else 0.0
        north, east, down = target.position_ned_m
        ahead = (north + share * target.velocity_ned_m_s[0], east + share * target.velocity_ned_m_s[1], down)
        field, keep_m = ObstacleField(points, at, self.settings.keep_m), self.settings.keep_m - NARROW_M
        return min(field.leg_clearance_m(at, target.position_ned_m), field.leg_clearance_m(at, ahead)) < keep_m

    def _turn(self, heading: HeadingOrder, bearing_rad: float | None, pose: Pose, duration_s: float) -> None:
        match heading.mode:
            case "along":
                wanted = bearing_rad
            case "hold":
                wanted = None
            case "fixed":
                wanted = heading.heading_rad
            case "look_at":
                point, at = heading.look_at_ned_m or pose.position_ned_m, pose.position_ned_m
                north, east = point[0] - at[0], point[1] - at[1]
                wanted = math.atan2(east, north) if math.hypot(north, east) > LOOK_AT_M else None
        if wanted is not None:
            step = self.settings.yaw_rate_rad_s * min(duration_s, 0.1)
            self._yaw_rad = wrap_pi(self._yaw_rad + min(max(wrap_pi(wanted - self._yaw_rad), -step), step))
