"""Follow: keeps a position relative to a target that reports its own (PX4's follow-me)."""

from math import atan2, cos, hypot, radians, sin

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import Mover
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint
from gloc3_sitl.autopilot.craft import Craft

_TIMEOUT_S = 3.0
"""Time for which a silent target's position is extrapolated, s."""
_WALKS_M_S = 0.5
"""Slower than this his course means nothing."""


class Follow(Mover):
    """Keeps a distance and a bearing from the target's course, and faces it; holds without a target."""

    __slots__ = ("_course_rad",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.trajectory.stop()
        self._course_rad: float | None = None

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if craft.is_landed:
            self.resync()
            return LANDED
        target = craft.target
        if target is None or craft.now_s - target.t_s > _TIMEOUT_S:
            self._course_rad = None
            return self.fly()
        age_s = craft.now_s - target.t_s
        n, e, d = target.position_ned_m
        vn, ve, _ = target.velocity_ned_m_s
        n, e = n + vn * age_s, e + ve * age_s
        at_n, at_e, _ = craft.estimator.inertial.position_ned_m
        if hypot(vn, ve) > _WALKS_M_S:
            self._course_rad = atan2(ve, vn)
        elif self._course_rad is None:
            self._course_rad = atan2(e - at_e, n - at_n)
        tuning = craft.tuning
        bearing = self._course_rad + radians(tuning.follow_bearing_deg)
        self.trajectory.go_to(
            (
                n + tuning.follow_distance_m * cos(bearing),
                e + tuning.follow_distance_m * sin(bearing),
                self._down(d) - tuning.follow_height_m,
            )
        )
        self.yaw_wanted_rad = atan2(e - at_e, n - at_n)
        return self.fly()

    def _down(self, target_down_m: float) -> float:
        """What the height counts from, as NED down."""
        craft = self.craft
        match craft.tuning.follow_height_over:
            case 1:
                return craft.estimator.ground_down_m
            case 2:
                return target_down_m
            case _:
                return 0.0 if craft.home is None else craft.home.position_ned_m[2]

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the vehicle corrects its path."""
        del jump_ned_m
        self.resync()
