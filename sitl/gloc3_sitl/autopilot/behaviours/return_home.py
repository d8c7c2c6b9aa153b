"""Return: climb, fly back, come down, land."""

from enum import StrEnum
from math import hypot

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import Mover
from gloc3_sitl.autopilot.behaviours.land import LandInPlace
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint
from gloc3_sitl.autopilot.craft import Craft


class ReturnPhase(StrEnum):
    """Phases of a return."""

    CLIMB = "climb"
    BACK = "back"
    DESCEND = "descend"
    WAIT = "wait"
    LAND = "land"


class ReturnFlight(Mover):
    """Flies to home or to the nearest rally point, and lands there."""

    __slots__ = ("_goal", "_land", "_phase_s", "is_done", "phase")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.is_done = False
        self._land: LandInPlace | None = None
        self._goal = nearest_goal(craft)
        self._phase_s = craft.now_s
        n, e, d = self.trajectory.position
        top = self._goal[2] - craft.tuning.return_height_m
        if self.horizontal_distance_to(self._goal) < craft.tuning.return_near_m:
            top = d
        self.phase = ReturnPhase.CLIMB
        self.trajectory.stop()
        n, e, _ = self.trajectory.target
        self.trajectory.go_to((n, e, min(d, top)))

    def _enter(self, phase: ReturnPhase, target: Vector3) -> None:
        self.phase, self._phase_s = phase, self.craft.now_s
        self.trajectory.go_to(target)

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the vehicle corrects its path; positions stay fixed on Earth."""
        del jump_ned_m
        self.resync()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if craft.is_landed:
            self.is_done = True
            return LANDED
        n, e, d = self._goal
        height = self.trajectory.target[2]
        match self.phase:
            case ReturnPhase.CLIMB:
                if self.trajectory.distance_m < 0.3:
                    self._enter(ReturnPhase.BACK, (n, e, height))
            case ReturnPhase.BACK:
                if self.horizontal_distance_to(self._goal) < 0.5 and self.trajectory.distance_m < 0.3:
                    down = max(height, d - max(craft.tuning.return_descend_m, 1.0))
                    self._enter(ReturnPhase.DESCEND, (n, e, down))
            case ReturnPhase.DESCEND:
                if self.trajectory.distance_m < 0.3:
                    self._enter(ReturnPhase.WAIT, self.trajectory.target)
            case ReturnPhase.WAIT:
                if craft.now_s - self._phase_s >= craft.tuning.return_wait_s:
                    self.phase = ReturnPhase.LAND
                    self._land = LandInPlace(craft, self.trajectory.target)
            case ReturnPhase.LAND:
                assert self._land is not None
                setpoint = self._land.update()
                self.is_done = self._land.is_done
                return setpoint
        return self.fly()


def nearest_goal(craft: Craft) -> Vector3:
    """Home, or the rally point that is nearer."""
    n, e, _ = craft.estimator.inertial.position_ned_m
    best = craft.home.position_ned_m if craft.home is not None else (n, e, 0.0)
    origin = craft.estimator.origin
    if origin is None:
        return best
    ground = best[2]
    for item in craft.plans.rally:
        rn, re, _ = origin.ned_from_geo(item.latitude_deg, item.longitude_deg, origin.origin.altitude_m)
        if hypot(rn - n, re - e) < hypot(best[0] - n, best[1] - e):
            best = (rn, re, ground)
    return best
