"""Guides the vehicle along a path and waits where it cannot follow; shared by the path controllers."""

import math
from typing import Final

from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import DriverState, Pose
from gloc3_onboard.algorithms.paths.path_follower import PathFollower, PathTarget

GAP_S: Final = 0.5
"""Interruption after which the vehicle is led back to where it left the path, s."""
STEP_S: Final = 0.1
DRIVER_S: Final = 0.5
"""Age from which the driver's state is ignored, s."""
CALM_S: Final = 0.3
"""Time at low speed after which a vehicle counts as at rest, s."""
TIMEOUT_S: Final = 3.0
"""So long its rest at the end is waited for; in gusts, or with a restless estimate, it may never quite come."""


class PathReference:
    """Advances a `PathFollower` only while the autopilot follows the setpoints.

    Args:
        follower: moves along the path.
        now_s: start time.
        at_rest_m_s: speed up to which a vehicle is at rest.
    """

    def __init__(self, follower: PathFollower, now_s: float, at_rest_m_s: float = 0.2) -> None:
        self.follower: Final = follower
        self._at_rest_m_s = at_rest_m_s
        self._last_s = now_s
        self._left_alone_s = 0.0
        self._has_gap = False
        self._refusal = ""
        self._away_m = math.inf
        self._at_end_s = 0.0
        """Time since the end of the path was reached, without interruptions; 0 before."""
        self._calm_since_s: float | None = None

    def is_there(self, within_m: float) -> bool:
        """Whether the vehicle is at rest near the end of the path, or has had the time to come to rest there."""
        if not self.follower.is_at_end:
            return False
        is_calm = self._calm_since_s is not None and self._last_s - self._calm_since_s >= CALM_S
        return (is_calm and self._away_m <= within_m) or self._at_end_s > TIMEOUT_S

    def advance(
        self, pose: Pose, driver: Envelope[DriverState] | None, now_s: float, *, is_waiting: bool = False
    ) -> PathTarget:
        """The current target; called in every cycle with a valid pose.

        Args:
            pose: pose of the vehicle.
            driver: whether the autopilot follows.
            now_s: the time.
            is_waiting: whether the point waits for a reason other than the vehicle.
        """
        duration_s, was_at_end = min(now_s - self._last_s, GAP_S), self.follower.is_at_end
        target = self._advance(pose, driver, now_s, is_waiting=is_waiting)
        if math.hypot(*pose.velocity_ned_m_s) > self._at_rest_m_s:
            self._calm_since_s = None
        elif self._calm_since_s is None:
            self._calm_since_s = now_s
        self._away_m = math.dist(pose.position_ned_m, target.position_ned_m)
        self._at_end_s = self._at_end_s + duration_s if was_at_end and self.follower.is_at_end else 0.0
        return target

    def _advance(
        self, pose: Pose, driver: Envelope[DriverState] | None, now_s: float, *, is_waiting: bool
    ) -> PathTarget:
        duration_s, self._last_s = now_s - self._last_s, now_s
        is_followed = driver is not None and driver.payload.is_guided and now_s - driver.t_s <= DRIVER_S
        if duration_s > GAP_S or not is_followed:
            self._has_gap = True
        if not is_followed:
            self._left_alone_s += min(duration_s, GAP_S)
            self._refusal = driver.payload.refusal if driver is not None else ""
            self.follower.halt()
            return self.follower.advance(0.0, pose.position_ned_m)
        self._left_alone_s = 0.0
        if self._has_gap:
            self._has_gap = False
            self.follower.rejoin(pose.position_ned_m)
        if is_waiting:
            self.follower.halt()
            return self.follower.advance(0.0, pose.position_ned_m)
        return self.follower.advance(min(duration_s, STEP_S), pose.position_ned_m)

    def problem(self, timeout_s: float, follow_s: float = 30.0) -> str:
        """Why it makes no progress; empty if it does.

        Args:
            timeout_s: longest wait for the vehicle to reach the point.
            follow_s: longest wait for the autopilot to follow.
        """
        if self._left_alone_s > follow_s:
            return "the autopilot does not follow our setpoints" + (f": {self._refusal}" if self._refusal else "")
        if self._at_end_s > timeout_s or self.follower.waited_s > timeout_s:
            return f"the vehicle does not come to waypoint {self.follower.waypoint + 1}"
        return ""
