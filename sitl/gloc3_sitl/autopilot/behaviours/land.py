"""Landing: straight down until touchdown."""

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import PERIOD_S, Mover
from gloc3_sitl.autopilot.control.setpoint import LANDED, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft

LAG_M = 0.3
"""So far a descending vehicle is behind its goal anyway, m."""
LEASH_M = 1.5
"""Farthest distance from vehicle to goal, m."""


class LandInPlace(Mover):
    """Holds the horizontal position and descends; done on the ground.

    Without a position estimate it stays level and drifts with the wind; without a height it still descends by speed,
    since the accelerometer provides the vertical velocity for a while.
    """

    __slots__ = ("_descent_m_s", "is_done")

    def __init__(self, craft: Craft, place_ned_m: Vector3 | None = None) -> None:
        super().__init__(craft)
        self.is_done = False
        self._descent_m_s = max(0.0, craft.estimator.inertial.velocity_ned_m_s[2])
        if place_ned_m is None:
            self.trajectory.stop()
        else:
            self.trajectory.go_to(place_ned_m)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if craft.is_landed:
            self.is_done = True
            return LANDED
        tuning = craft.tuning
        is_low = craft.height_over_ground_m < tuning.land_slow_height_m
        wanted = tuning.land_speed_m_s if is_low else tuning.land_fast_speed_m_s
        step = 1.0 * PERIOD_S
        self._descent_m_s += max(-step, min(step, wanted - self._descent_m_s))
        if not craft.estimator.is_position_good(craft.now_s):
            nothing = float("nan")
            return MotionSetpoint(velocity_ned_m_s=(nothing, nothing, self._descent_m_s), yaw_rad=self.yaw_rad)
        n, e, _ = self.trajectory.target
        down = craft.estimator.inertial.position_ned_m[2]
        self.trajectory.position = (*self.trajectory.position[:2], down)  # it goes to its place while it comes down
        self.trajectory.go_to((n, e, down))
        hold = self.glide()
        n, e, _ = hold.position_ned_m
        vn, ve, _ = hold.velocity_ned_m_s
        return MotionSetpoint(
            position_ned_m=(n, e, float("nan")), velocity_ned_m_s=(vn, ve, self._sink(down)), yaw_rad=hold.yaw_rad
        )

    def _sink(self, down_m: float) -> float:
        """The vertical speed to fly, m/s down, at a height."""
        return self._descent_m_s


class LandAfterGoal(LandInPlace):
    """ArduPilot's landing: a goal descends at the landing speed, and a vehicle that stays behind it descends faster.

    So a vehicle whose estimate does not come down, by ground or by a frozen receiver, is soon at the least thrust.
    """

    __slots__ = ("_goal_down_m",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._goal_down_m = craft.estimator.inertial.position_ned_m[2]

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The goal jumps with the estimate."""
        super().on_jump(jump_ned_m)
        self._goal_down_m += jump_ned_m[2]

    def _sink(self, down_m: float) -> float:
        self._goal_down_m = min(self._goal_down_m + self._descent_m_s * PERIOD_S, down_m + LEASH_M)
        return self._descent_m_s + max(0.0, self._goal_down_m - down_m - LAG_M)
