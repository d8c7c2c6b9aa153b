"""CC: attains a list of waypoints with a vehicle that steers by its heading and drifts: a boat, a submarine."""

import math
from collections.abc import Sequence
from typing import Annotated, Final

from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.line_of_sight import LineOfSight, corner_speed_m_s, heading_vector, slowed_m_s
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, wrap_pi, yaw_of
from gloc3.messages.standard_topics import POSE_LATE_S
from gloc3.messages.vehicle import DriverState, Pose, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder, ReturnHome
from gloc3.mission.model.states import ActionState
from gloc3.mission.model.waypoint_options import refuse_unkept
from gloc3_onboard.components.controllers.waypoint_performer import WaypointPerformer

DRIVER_S: Final = 0.5
"""Age above which the driver's state is ignored, s."""
GAP_S: Final = 0.5
"""Interruption after which a vehicle that has left the waypoint where it rested goes back to it, s."""
PAST_M: Final = 0.1
"""Distance beyond a waypoint, along the path, at which it is passed, m."""
MISSES: Final = 2
"""So often it turns back for a waypoint that it has passed too far aside."""
LEAST_M_S: Final = 0.3
"""Lowest speed at which a boat steers, m/s; kept to the end of a path."""
REST_S: Final = 5.0
"""Time at the last waypoint after which a vehicle that never quite rests, in waves, is done, s."""
STRAIGHT_ON_RAD: Final = 0.5
"""Largest turn of the path that keeps the drift estimate, rad."""
BRAKING_SHARE: Final = 0.5
SLOWLY: Final = 0.3
"""Share of its speed with which it turns round."""
DEPTH_HZ: Final = 0.4
"""Vertical speed per metre of height error, 1/s."""


class LineOfSightSettings(Settings, frozen=True):
    """Settings of the line-of-sight controller."""

    acceleration_m_s2: Annotated[float, Bounds(0.05, 5.0)] = 0.3
    """Acceleration along the path, in m/s²; braking uses half of it."""
    lookahead_s: Annotated[float, Bounds(0.5, 30.0)] = 3.0
    """Look-ahead time of the steering, in seconds: longer is calmer, shorter is closer."""
    lookahead_m: Annotated[float, Bounds(0.5, 100.0)] = 3.0
    """But no nearer than this, in metres: one to two lengths of the vehicle."""
    drift_s: Annotated[float, Bounds(0.1, 60.0)] = 3.0
    """Averaging time of the measured sideways drift, in seconds."""
    integral: Annotated[float, Bounds(0.0, 1.0)] = 0.04
    """Rate at which the residual lateral error is learned, 1/s: less than a quarter of 1/`lookahead_s`."""
    turn_rate_rad_s: Annotated[float, Bounds(0.02, 3.0)] = 0.1
    """Turn rate under way, in rad/s; it limits the speed in corners to keep within the acceptance."""
    climb_m_s: Annotated[float, Bounds(0.0, 5.0)] = 0.0
    """Largest vertical speed, in m/s; 0 for surface vehicles."""
    return_speed_m_s: Annotated[float, Bounds(0.1, 50.0)] = 1.5
    """Speed of a return home that names none."""
    at_rest_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.3
    """The action is done when the vehicle is at the last waypoint and no faster than this."""
    slow_s: Annotated[float, Bounds(5.0, 3600.0)] = 60.0
    """Longest time without coming nearer to the next waypoint, before the action fails."""
    follow_s: Annotated[float, Bounds(1.0, 600.0)] = 30.0
    """Longest wait for the autopilot to follow the setpoints, before the action fails."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""


class LineOfSightController(WaypointPerformer, Controller[LineOfSightSettings]):
    """Streams a velocity along the path, corrected against drift, whose direction is the heading.

    It follows waypoints and orders like `WaypointsController`, but without a moving target: in a current, a boat that
    chases one runs beside the path, or falls behind. Without a valid pose it streams nothing.
    """

    loggable = ("waypoint", "cross_track_m", "crab_m", "drift_m_s", "left_m")
    chooses_heading = False

    def __init__(self) -> None:
        self.waypoint = 0
        self.cross_track_m = self.crab_m = self.left_m = self.drift_m_s = 0.0
        self._guide = LineOfSight()
        self._reset(0.0)

    def _reset(self, now_s: float) -> None:
        self._start_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._last_s = self._guided_s = now_s
        self._now_m_s = self._alone_s = self._length_m = 0.0
        self._nearest_m, self._nearer_s = math.inf, now_s
        self._misses, self.drift_m_s = 0, 0.0
        self._rested_s: float | None = None
        """Time at a waypoint where it stops, without interruptions; None under way."""
        self._refusal = ""

    def stop(self) -> None:
        """Drops the action under way."""
        self.drop_action()
        self._order = None

    # --- actions ---

    def begin_action(self, capability: str, arguments: FollowWaypointsOrder | ReturnHome, now_s: float) -> None:
        """Plans the path from the vehicle's position through the waypoints that no earlier attempt has passed."""
        pose, order = self.wanted(arguments)
        refuse_unkept(order, self.keeps, "a vehicle that steers by its heading")
        if not order.heading.follows_path:
            raise Refused(f"a vehicle that steers by its heading cannot choose it: heading {order.heading.mode}")
        self._order = order
        self._guide = LineOfSight(self.settings.integral)
        self._reset(now_s)
        passed = self.passed(order, pose.position_ned_m)
        start = order.waypoints_ned_m[passed - 1] if passed else pose.position_ned_m
        while not order.rest_s and passed < len(order.waypoints_ned_m) - 1:
            here = order.waypoints_ned_m[passed]
            if math.dist(here[:2], pose.position_ned_m[:2]) > order.acceptance_m:
                break
            start, passed = here, passed + 1
        self._head_for(passed, start, now_s)

    def path_home(self, arguments: ReturnHome, home_ned_m: Vector3, here_ned_m: Vector3) -> FollowWaypointsOrder:
        """Straight home, nose first."""
        north, east, home_down = home_ned_m
        down = here_ned_m[2] if arguments.height_m is None else home_down - arguments.height_m
        return FollowWaypointsOrder(
            waypoints_ned_m=((north, east, down),),
            speed_m_s=arguments.speed_m_s or self.settings.return_speed_m_s,
            heading=HeadingOrder(mode="along"),
            acceptance_m=max(1.0, self.settings.lookahead_m),
        )

    def pause_action(self, now_s: float) -> None:
        """Rests and keeps the path."""
        self._now_m_s = 0.0

    def end_action(self, now_s: float) -> None:
        """Drops the path."""
        self._order = None

    # --- cycles ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Steers on."""
        self.update_pose(inbox, now_s, self.settings.pose_limit_s)
        results: list[Result] = []
        duration_s, self._last_s = now_s - self._last_s, now_s
        if not self.is_running or self._order is None:
            self._nearer_s = now_s
        elif self._pose is not None and self._pose.is_valid:
            is_guided = self._is_guided(inbox.latest(self.driver), duration_s, now_s)
            if is_guided:
                self._rejoin(self._order, self._pose.position_ned_m, now_s)
            results.append(self._steer(self._order, self._pose, now_s, min(duration_s, 0.1) if is_guided else 0.0))
        return [*results, *self.action_reports(now_s)]

    def _is_guided(self, driver: Envelope[DriverState] | None, duration_s: float, now_s: float) -> bool:
        """Whether the autopilot follows; and for how long it has not."""
        is_guided = driver is not None and driver.payload.is_guided and now_s - driver.t_s <= DRIVER_S
        self._alone_s = 0.0 if is_guided else self._alone_s + min(duration_s, DRIVER_S)
        self._refusal = "" if is_guided or driver is None else driver.payload.refusal
        if not is_guided:
            self._nearer_s, self._now_m_s = now_s, 0.0
        return is_guided

    def _rejoin(self, order: FollowWaypointsOrder, here_ned_m: Vector3, now_s: float) -> None:
        """After an interruption, returns to the waypoint where it rested if it is there no longer."""
        is_back, self._guided_s = now_s - self._guided_s > GAP_S, now_s
        if not is_back:
            return
        self._nearest_m = math.inf
        away_m = math.dist(order.waypoints_ned_m[self.waypoint][:2], here_ned_m[:2])
        if self._rested_s is not None and away_m > order.acceptance_m:
            self._head_for(self.waypoint, here_ned_m, now_s)

    def _head_for(self, waypoint: int, start: Vector3, now_s: float) -> None:
        """Makes another waypoint the next."""
        assert self._order is not None
        target, before = self._order.waypoints_ned_m[waypoint], self._guide.course_rad
        course = math.atan2(target[1] - start[1], target[0] - start[0])
        self._guide.follow(start, target, keeps_drift=abs(wrap_pi(course - before)) < STRAIGHT_ON_RAD)
        self._start_ned_m, self._length_m = start, math.dist(start[:2], target[:2])
        self.waypoint, self._nearest_m, self._nearer_s = waypoint, math.inf, now_s
        self._rested_s = None

    def _steer(self, order: FollowWaypointsOrder, pose: Pose, now_s: float, duration_s: float) -> Setpoint:
        settings, place = self.settings, order.waypoints_ned_m[self.waypoint]
        ahead_m = max(settings.lookahead_m, settings.lookahead_s * self._now_m_s)
        guidance = self._guide.update(pose.position_ned_m, ahead_m, duration_s)
        self.cross_track_m, self.crab_m, self.left_m = guidance.cross_track_m, self._guide.crab_m, guidance.left_m
        away_m = math.dist(place[:2], pose.position_ned_m[:2])
        if self._rested_s is not None:
            self._rested_s += duration_s
        if away_m < self._nearest_m - 0.5 or self._rested_s is not None:
            self._nearest_m, self._nearer_s = min(away_m, self._nearest_m), now_s
        action_id, problem = self.action_id, self._problem(now_s)
        is_last = self.waypoint == len(order.waypoints_ned_m) - 1
        if problem:
            self.advance(now_s, self._progress(order), ActionState.FAILED, f"{problem} ({away_m:.1f} m away)")
            return Setpoint(action_id=action_id, velocity_ned_m_s=(0.0, 0.0, 0.0))
        if self._rested_s is None and self._is_passed(order, away_m, guidance.left_m):
            if is_last or order.rest_s > 0.0:
                self._rested_s = 0.0
            else:
                self._head_for(self.waypoint + 1, place, now_s)
        elif self._rested_s is None and guidance.left_m < -max(order.acceptance_m, 1.0):
            self._misses += 1
            self._head_for(self.waypoint, pose.position_ned_m, now_s)
        if self._rested_s is not None:
            return self._remainder(order, pose, place, now_s, self._rested_s, is_last=is_last)
        self.advance(now_s, self._progress(order), achieved=self.waypoint)
        wanted = slowed_m_s(
            order.speed_m_s, guidance.left_m, self._end_m_s(order), BRAKING_SHARE * settings.acceleration_m_s2
        )
        heading_rad = self._against_drift(guidance.heading_rad, pose, duration_s)
        # The farther the nose is off, the less it helps to go on.
        wanted *= max(SLOWLY, math.cos(heading_rad - yaw_of(pose.ned_from_frd)))
        self._now_m_s = max(
            min(LEAST_M_S, order.speed_m_s), min(wanted, self._now_m_s + settings.acceleration_m_s2 * duration_s)
        )
        north, east, _ = heading_vector(heading_rad, self._now_m_s)
        return Setpoint(action_id=action_id, velocity_ned_m_s=(north, east, self._sink_m_s(pose, place)))

    def _against_drift(self, course_rad: float, pose: Pose, duration_s: float) -> float:
        """Heading that holds a course against the measured sideways speed."""
        yaw, (north, east, _) = yaw_of(pose.ned_from_frd), pose.velocity_ned_m_s
        heading_rad = course_rad - math.atan2(self.drift_m_s, max(self._now_m_s, LEAST_M_S))
        if abs(wrap_pi(heading_rad - yaw)) < STRAIGHT_ON_RAD:  # in a turn it slips
            aside_m_s = east * math.cos(yaw) - north * math.sin(yaw)
            self.drift_m_s += min(1.0, duration_s / self.settings.drift_s) * (aside_m_s - self.drift_m_s)
        return wrap_pi(heading_rad)

    def _remainder(
        self, order: FollowWaypointsOrder, pose: Pose, place: Vector3, now_s: float, rested_s: float, *, is_last: bool
    ) -> Setpoint:
        """At a waypoint where it stops."""
        self._now_m_s, action_id = 0.0, self.action_id
        if rested_s >= order.rest_s and not is_last:
            self._head_for(self.waypoint + 1, place, now_s)
        elif rested_s >= order.rest_s:
            is_slow = math.hypot(*pose.velocity_ned_m_s[:2]) < self.settings.at_rest_m_s
            is_done = is_slow or rested_s >= order.rest_s + REST_S
            state = ActionState.DONE if is_done else ActionState.RUNNING
            count = len(order.waypoints_ned_m)
            self.advance(now_s, 1.0 if is_done else self._progress(order), state, achieved=count if is_done else None)
        return Setpoint(action_id=action_id, velocity_ned_m_s=(0.0, 0.0, self._sink_m_s(pose, place)))

    def _is_passed(self, order: FollowWaypointsOrder, away_m: float, left_m: float) -> bool:
        """Whether the waypoint counts as passed: as late as permitted, so that corners are kept."""
        if away_m > order.acceptance_m:
            return False
        turns_early_m = 0.5 * order.acceptance_m
        return left_m < (turns_early_m if self._end_m_s(order) else PAST_M + 0.25 * order.acceptance_m)

    def _end_m_s(self, order: FollowWaypointsOrder) -> float:
        """The speed at which the next waypoint is passed; 0 where it stops."""
        if order.rest_s > 0.0 or self.waypoint + 1 >= len(order.waypoints_ned_m):
            return 0.0
        here, after = order.waypoints_ned_m[self.waypoint : self.waypoint + 2]
        turn = wrap_pi(math.atan2(after[1] - here[1], after[0] - here[0]) - self._guide.course_rad)
        return max(LEAST_M_S, corner_speed_m_s(turn, order.acceptance_m, self.settings.turn_rate_rad_s))

    def _sink_m_s(self, pose: Pose, place: Vector3) -> float:
        """Vertical speed, positive down, towards the straight line between the waypoints."""
        most = self.settings.climb_m_s
        share = 1.0 - max(0.0, self.left_m) / self._length_m if self._length_m > 0.0 else 1.0
        wanted_down = self._start_ned_m[2] + min(max(share, 0.0), 1.0) * (place[2] - self._start_ned_m[2])
        return min(max(DEPTH_HZ * (wanted_down - pose.position_ned_m[2]), -most), most)

    def _progress(self, order: FollowWaypointsOrder) -> float:
        share = 1.0 - max(0.0, self.left_m) / self._length_m if self._length_m > 0.0 else 0.0
        return (self.waypoint + min(max(share, 0.0), 0.99)) / len(order.waypoints_ned_m)

    def _problem(self, now_s: float) -> str:
        settings = self.settings
        if self._alone_s > settings.follow_s:
            return "the autopilot does not follow our setpoints" + (f": {self._refusal}" if self._refusal else "")
        if self._misses > MISSES or now_s - self._nearer_s > settings.slow_s:
            return f"the vehicle does not come to waypoint {self.waypoint + 1}"
        return ""
