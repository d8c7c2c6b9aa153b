"""The interface of a behaviour, and the shared part: a smooth trajectory to a position with a heading."""

from abc import ABC, abstractmethod
from math import atan2, hypot, nan, sqrt

from gloc3.messages.frames import Vector3, wrap_pi
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.control.trajectory import SmoothTrajectory, TrajectoryLimits
from gloc3_sitl.autopilot.craft import Craft

PERIOD_S = 0.02
"""Time between two setpoints."""

_LAG_M = 1.0
"""Lag behind the trajectory beyond which the trajectory waits, m."""


class Activity(ABC):
    """An active behaviour, created when its mode is entered."""

    __slots__ = ("craft",)

    is_done: bool = False
    """Whether it is complete; the style defines what follows."""

    def __init__(self, craft: Craft) -> None:
        self.craft = craft

    @abstractmethod
    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""

    def on_jump(self, jump_ned_m: Vector3) -> None:  # noqa: B027 # most have nothing to move
        """Handles a jump of the position estimate by this offset; the vehicle has not moved."""


class GoesTo(Activity):
    """A behaviour that accepts a target position."""

    __slots__ = ()

    @abstractmethod
    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Sets the target position; NaN keeps heading and speed."""


class TakesOff(Activity):
    """A behaviour that accepts a take-off from the ground."""

    __slots__ = ()

    @abstractmethod
    def take_off(self, target_down_m: float) -> None:
        """Climbs from the ground to a height, as NED down."""


class FliesMission(Activity):
    """A behaviour that flies the uploaded mission."""

    __slots__ = ()

    @abstractmethod
    def skip_to(self, index: int) -> None:
        """Makes another item the current one."""

    @abstractmethod
    def pause(self) -> None:
        """Stops here, inside the mode."""

    @abstractmethod
    def go_on(self) -> None:
        """Resumes after a pause."""


class Mover(Activity):
    """Advances a smooth trajectory and a heading towards the subclass's target."""

    __slots__ = ("trajectory", "yaw_rad", "yaw_wanted_rad")

    def __init__(self, craft: Craft, limits: TrajectoryLimits | None = None) -> None:
        super().__init__(craft)
        inertial = craft.estimator.inertial
        self.trajectory = SmoothTrajectory(
            craft.tuning.limits if limits is None else limits, inertial.position_ned_m, inertial.velocity_ned_m_s
        )
        self.yaw_rad = craft.estimator.yaw_rad
        self.yaw_wanted_rad = self.yaw_rad

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the trajectory and its target jump with it, so that nothing moves."""
        north, east, down = jump_ned_m
        n, e, d = self.trajectory.position
        self.trajectory.position = (n + north, e + east, d + down)
        n, e, d = self.trajectory.target
        self.trajectory.go_to((n + north, e + east, d + down))

    def resync(self) -> None:
        """Continues from the vehicle's estimated position."""
        inertial = self.craft.estimator.inertial
        self.trajectory.position = inertial.position_ned_m
        self.trajectory.velocity = inertial.velocity_ned_m_s
        self.trajectory.acceleration = (0.0, 0.0, 0.0)

    def fly(self) -> Setpoint:
        """Advances by one period."""
        return self.glide()

    def glide(self) -> MotionSetpoint:
        """Advances trajectory and heading by one period."""
        trajectory = self.trajectory
        n, e, d = self.craft.estimator.inertial.position_ned_m
        pn, pe, pd = trajectory.position
        lag = sqrt((pn - n) ** 2 + (pe - e) ** 2 + (pd - d) ** 2)
        pace = 1.0 if lag < _LAG_M else max(0.0, 2.0 - lag / _LAG_M)
        trajectory.advance(PERIOD_S * pace)
        self.turn()
        vn, ve, vd = trajectory.velocity
        return MotionSetpoint(
            position_ned_m=trajectory.position,
            velocity_ned_m_s=(pace * vn, pace * ve, pace * vd),  # of a trajectory that waits for it, too
            acceleration_ned_m_s2=trajectory.acceleration if pace == 1.0 else (0.0, 0.0, 0.0),
            yaw_rad=self.yaw_rad,
        )

    def turn(self) -> float:
        """Advances the heading setpoint by one period, and returns it."""
        place = self.craft.is_facing
        if place is not None:
            n, e, _ = self.craft.estimator.inertial.position_ned_m
            self.yaw_wanted_rad = atan2(place[1] - e, place[0] - n)
        turn = wrap_pi(self.yaw_wanted_rad - self.yaw_rad)
        step = self.craft.tuning.yaw_rate_rad_s * PERIOD_S
        if turn > step:
            turn = step
        elif turn < -step:
            turn = -step
        self.yaw_rad = wrap_pi(self.yaw_rad + turn)
        return self.yaw_rad

    def horizontal_distance_to(self, position_ned_m: Vector3) -> float:
        """Horizontal distance from the vehicle's estimated position."""
        n, e, _ = self.craft.estimator.inertial.position_ned_m
        return hypot(position_ned_m[0] - n, position_ned_m[1] - e)
