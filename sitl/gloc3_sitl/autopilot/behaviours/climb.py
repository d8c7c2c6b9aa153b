"""Take-off: straight up from the ground to a height."""

from dataclasses import replace

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import Mover
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint
from gloc3_sitl.autopilot.craft import Craft

_SPIN_UP_S = 0.8
"""Idle time of the motors before the climb, s."""


class ClimbToHeight(Mover):
    """Climbs to a height over the estimator's origin; done when it is there."""

    __slots__ = ("_start_s", "_target_down_m", "is_done")

    def __init__(self, craft: Craft, target_down_m: float) -> None:
        limits = craft.tuning.limits
        super().__init__(craft, replace(limits, speed_up_m_s=craft.tuning.takeoff_speed_m_s))
        self._target_down_m = target_down_m
        self._start_s = -1.0
        self.is_done = False

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the height to climb to jumps too."""
        super().on_jump(jump_ned_m)
        self._target_down_m += jump_ned_m[2]

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if not craft.is_armed:
            self._start_s = -1.0
            return LANDED
        if self._start_s < 0.0:
            self._start_s = craft.now_s
        if craft.is_landed and craft.now_s - self._start_s < _SPIN_UP_S:
            self.resync()
            n, e, _ = craft.estimator.inertial.position_ned_m
            self.trajectory.velocity = (0.0, 0.0, 0.0)
            self.trajectory.go_to((n, e, self._target_down_m))
            return LANDED
        setpoint = self.fly()
        down = craft.estimator.inertial.position_ned_m[2]
        if not craft.is_landed and down < self._target_down_m + 0.2 and self.trajectory.distance_m < 0.2:
            self.is_done = True
        return setpoint
