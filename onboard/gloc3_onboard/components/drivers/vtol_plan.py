"""AD: has a VTOL take off, fly its ways on wings or on rotors, and come home by plans of its autopilot."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Result
from gloc3.component.settings import Bounds
from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3, yaw_of
from gloc3.messages.vehicle import DriverState, ManoeuvreState, VtolForm
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.arguments import FollowWaypointsOrder, ReturnHome, TakeOff, VtolTransition
from gloc3.mission.model.waypoint_options import IN_PLANS
from gloc3_onboard.components.drivers.plan_flier import PlanControl
from gloc3_onboard.components.drivers.winged_flier import WIDEST_M, WingedFlier, WingedPlanSettings
from gloc3_onboard.sensors.devices import GeoPath, VtolWay

STOPPED_M_S: Final = 2.0
"""A hover is reached below this speed."""


class VtolPlanSettings(WingedPlanSettings, frozen=True):
    """Settings of the driver for the ways of VTOLs."""

    rotors_m_s: Annotated[float, Bounds(0.5, 20.0)] = 5.0
    """Speed over ground of ways on rotors that ask for more."""
    rotors_within_m: Annotated[float, Bounds(0.5, WIDEST_M)] = 2.0
    """So near it comes to a place on rotors. Ways that ask for less get this."""
    transition_m: Annotated[float, Bounds(10.0, 2_000.0)] = 150.0
    """Way from wings to a hover: so far before the last place it leaves its wings."""
    transition_s: Annotated[float, Bounds(5.0, 120.0)] = 30.0
    """Longest transition to wings from the beginning of its plan, before the action fails."""


class VtolPlan(WingedFlier[VtolPlanSettings], ActuatorDriver[VtolPlanSettings]):
    """Performs `take_off`, `transition`, `return_home` and all that follows waypoints for VTOLs.

    A way on wings ends in a hover at its last place. A way is flown on wings where it asks for that, or where it is longer
    than two transitions and does not say; a return home likewise.
    """

    performs: ClassVar = {**WingedFlier.performs, "transition": VtolTransition}
    keeps = IN_PLANS | {"by"}
    loggable = ("uploads", "waypoint")

    def __init__(self, device: PlanControl) -> None:
        super().__init__(device)
        self._goes_on_wings = False
        self._hovers = True
        self._climb_m = 0.0
        self._flies_since_s = math.inf
        """When the autopilot began to fly the plan."""
        self._has_left_rotors = self._was_on_wings = False

    def begin_action(
        self,
        capability: str,
        arguments: FollowWaypointsOrder | ReturnHome | TakeOff | VtolTransition | FlyFileOrder,
        now_s: float,
    ) -> None:
        """Takes up the way, in the form that it asks for or that suits its length."""
        if isinstance(arguments, FlyFileOrder):
            super().begin_action(capability, arguments, now_s)
            return
        pose = self._pose
        if pose is None:
            raise Refused("there is no valid pose")
        self._hovers, self._climb_m = True, 0.0
        here = pose.position_ned_m
        match arguments:
            case VtolTransition(to=to):
                self._refuse_on_the_ground()
                self._goes_on_wings, self._hovers = to == "wings", to == "rotors"
                order = self._ahead(here)
                super().begin_action(capability, order, now_s)
                return
            case TakeOff():
                self._goes_on_wings, self._climb_m = False, arguments.height_m
            case ReturnHome():
                self._goes_on_wings = self._is_far(here, self._path_home(arguments, here).waypoints_ned_m, None)
            case _:
                self._goes_on_wings = self._is_far(here, arguments.waypoints_ned_m, arguments.by)
        super().begin_action(capability, arguments, now_s)

    def _refuse_on_the_ground(self) -> None:
        if self._is_on_the_ground:
            raise Refused("a transition needs height: take off first")

    def _is_far(self, here: Vector3, places: Sequence[Vector3], by: str | None) -> bool:
        if by is not None:
            return by == "wings"
        length_m, start = 0.0, here
        for place in places:
            length_m += math.dist(start[:2], place[:2])
            start = place
        return length_m > 2.0 * self.settings.transition_m

    def _ahead(self, here: Vector3) -> FollowWaypointsOrder:
        """A place on the course, or where the nose points: as far as the transition takes."""
        assert self._pose is not None
        north_m_s, east_m_s, _ = self._pose.velocity_ned_m_s
        is_moving = math.hypot(north_m_s, east_m_s) > STOPPED_M_S
        course_rad = math.atan2(east_m_s, north_m_s) if is_moving else yaw_of(self._pose.ned_from_frd)
        ahead_m = self.settings.transition_m if self._goes_on_wings or is_moving else 0.0
        north, east, down = here
        place = (north + ahead_m * math.cos(course_rad), east + ahead_m * math.sin(course_rad), down)
        return FollowWaypointsOrder(waypoints_ned_m=(place,), speed_m_s=self.settings.cruise_m_s)

    def _restart(self, now_s: float) -> None:
        if self._goes_on_wings and self._order is not None and self._pose is not None:
            places, within_m = self._order.waypoints_ned_m, self.settings.comes_within_m
            while self.waypoint < len(places) - 1 and self._is_at(places[self.waypoint], within_m):
                self.waypoint += 1  # wings would turn round to it
        super()._restart(now_s)
        self._flies_since_s, self._has_left_rotors, self._was_on_wings = math.inf, False, False

    def _is_at(self, place: Vector3, within_m: float) -> bool:
        return self._pose is not None and math.dist(self._pose.position_ned_m[:2], place[:2]) < within_m

    @property
    def _least_within_m(self) -> float:
        return self.settings.comes_within_m if self._goes_on_wings else self.settings.rotors_within_m

    def path(self, order: FollowWaypointsOrder, places: tuple[GeoPoint, ...]) -> GeoPath:
        """On wings or on rotors; a take-off that was paused in the air is a way like any other."""
        way = super().path(order, places)
        is_climb = way.is_from_ground
        speed_m_s = way.speed_m_s if self._goes_on_wings else min(way.speed_m_s, self.settings.rotors_m_s)
        vtol = VtolWay(
            on_wings=self._goes_on_wings,
            hovers=self._hovers,
            within_m=self.settings.rotors_within_m,
            climb_m=self._climb_m if is_climb else 0.0,
            brakes_at=self._braking_place(order, places) if self._goes_on_wings and self._hovers else None,
        )
        return way._replace(is_winged=self._goes_on_wings, speed_m_s=speed_m_s, vtol=vtol)

    def _braking_place(self, order: FollowWaypointsOrder, places: tuple[GeoPoint, ...]) -> GeoPoint | None:
        """Where on the last leg it leaves its wings; None where that leg is too short for them."""
        assert self._pose is not None
        points = order.waypoints_ned_m
        start = points[-2] if len(places) > 1 else self._pose.position_ned_m
        length_m = math.dist(start[:2], points[-1][:2])
        if length_m <= self.settings.transition_m:
            return None
        share = self.settings.transition_m / length_m
        north, east = (share * (start[axis] - points[-1][axis]) for axis in range(2))
        before = TangentPlane(places[-1]).geo_from_ned((north, east, 0.0))
        return before._replace(altitude_m=places[-1].altitude_m)

    # --- the flight ---

    def _fly(self, order: FollowWaypointsOrder, driver: DriverState | None, now_s: float) -> list[Result]:
        state = self._autopilot
        is_flown = driver is not None and driver.manoeuvre_id == self.action_id
        if driver is not None and is_flown and driver.manoeuvre_state is ManoeuvreState.RUNNING:
            self._flies_since_s = min(self._flies_since_s, now_s)
        took_s = now_s - self._flies_since_s
        is_judged = took_s >= 0.0 and self._goes_on_wings and not self._was_on_wings
        if state is not None and state.form is not None and is_judged:
            self._was_on_wings = state.form is VtolForm.WINGS
            self._has_left_rotors |= state.form is VtolForm.TO_WINGS
            if (self._has_left_rotors and state.form is VtolForm.ROTORS) or took_s > self.settings.transition_s:
                self._fail(f"the transition to wings failed: after {took_s:.0f} s it is on rotors", now_s)
                return []
        return super()._fly(order, driver, now_s)
