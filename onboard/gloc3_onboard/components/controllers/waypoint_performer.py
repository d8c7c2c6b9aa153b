"""Base of controllers that follow waypoints: their actions, their inputs, and the begin of a path."""

from abc import abstractmethod
from typing import ClassVar

from gloc3.component.action import ActionPerformer
from gloc3.component.ports import Inbox, Input, Output
from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.messages.standard_topics import POSE_LOST_S
from gloc3.messages.vehicle import DriverState, Home, Pose, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, ReturnHome
from gloc3_onboard.algorithms.paths.path_follower import next_ahead


class WaypointPerformer(ActionPerformer):
    """Mix this into a controller that follows waypoints, and returns home, with setpoints."""

    performs: ClassVar = {
        "follow_waypoints": FollowWaypointsOrder,
        "go_to": FollowWaypointsOrder,
        "return_home": ReturnHome,
    }

    keeps: ClassVar[frozenset[str]] = frozenset({"acceptance_m", "hold_s"})
    """Waypoint options that it supports; missions with others are refused."""
    chooses_heading: ClassVar[bool] = True
    """Whether the vehicle may point elsewhere than along its path; else missions that ask for it are refused."""

    pose = Input(Pose)
    home = Input(Home)
    driver = Input(DriverState)
    setpoint_wanted = Output(Setpoint, frame="ned")

    _pose: Pose | None = None
    """The newest that is not late."""
    _begin_pose: Pose | None = None
    """Newest pose that is not lost: a path starts there and is flown once the pose is back."""
    _home_ned_m: Vector3 | None = None
    _order: FollowWaypointsOrder | None = None

    def update_pose(self, inbox: Inbox, now_s: float, pose_limit_s: float) -> None:
        """Takes in where the vehicle and its home are; a pose older than the limit is late."""
        latest = inbox.latest(self.pose)
        is_fresh = inbox.is_fresh(self.pose, now_s, pose_limit_s)
        self._pose = latest.payload if latest is not None and is_fresh else None
        self._begin_pose = latest.payload if latest is not None and now_s - latest.t_s <= POSE_LOST_S else None
        if (home := inbox.latest(self.home)) is not None:
            self._home_ned_m = home.payload.position_ned_m

    def wanted(self, arguments: FollowWaypointsOrder | ReturnHome) -> tuple[Pose, FollowWaypointsOrder]:
        """The vehicle's pose and the requested path.

        Raises:
            Refused: either is unknown, or the path is empty.
        """
        pose = self._begin_pose
        if pose is None or not pose.is_valid:
            raise Refused("there is no valid pose")
        if isinstance(arguments, FollowWaypointsOrder):
            order = arguments
        elif self._home_ned_m is None:
            raise Refused("home is not known")
        else:
            order = self.path_home(arguments, self._home_ned_m, pose.position_ned_m)
        if not order.waypoints_ned_m:
            raise Refused("there is no waypoint")
        return pose, order

    @abstractmethod
    def path_home(self, arguments: ReturnHome, home_ned_m: Vector3, here_ned_m: Vector3) -> FollowWaypointsOrder:
        """The path from the vehicle's position to home."""

    def passed(self, order: FollowWaypointsOrder, here_ned_m: Vector3) -> int:
        """Waypoints that an earlier attempt has passed; never the last."""
        count = len(order.waypoints_ned_m)
        passed = min(int(self.earlier_progress * count + 1e-6), count - 1)
        if passed and not order.rest_s:
            passed = next_ahead(here_ned_m, order.waypoints_ned_m, passed, order.acceptance_m)
        return passed
