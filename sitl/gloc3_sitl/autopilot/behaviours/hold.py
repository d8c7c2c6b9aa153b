"""Hold: stop, stay, and go to a position on request."""

from dataclasses import replace
from math import nan

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import GoesTo, Mover
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint
from gloc3_sitl.autopilot.craft import Craft


class HoldPosition(Mover, GoesTo):
    """Stops at the nearest reachable position and stays there; keeps the motors idling on the ground."""

    __slots__ = ("_is_going",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.trajectory.stop()
        self._is_going = False

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Flies to a place and holds there; NaN keeps heading and speed."""
        limits = self.craft.tuning.limits
        self.trajectory.limits = limits if not speed_m_s > 0.0 else replace(limits, speed_xy_m_s=speed_m_s)
        self.trajectory.go_to(position_ned_m, self.trajectory.position)
        if yaw_rad == yaw_rad:
            self.yaw_wanted_rad = yaw_rad

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if self.craft.is_landed:
            self.resync()
            return LANDED
        return self.fly()


class Brake(HoldPosition):
    """Stops as hard as the vehicle can, then holds."""

    __slots__ = ()

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        limits = craft.tuning.limits
        self.trajectory.limits = replace(
            limits, acceleration_xy_m_s2=2.0 * limits.acceleration_xy_m_s2, jerk_m_s3=2.0 * limits.jerk_m_s3
        )
        self.trajectory.stop()
