"""Base of drivers that have winged vehicles take off, fly paths and come home by plans of their autopilots."""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Generic, TypeVar

from msgspec.structs import replace

from gloc3.component.ports import Inbox, Input, Result
from gloc3.component.settings import Bounds
from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3.messages.vehicle import Home, LandedState, Manoeuvre
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.arguments import FollowWaypointsOrder, ReturnHome, TakeOff
from gloc3.mission.model.model import FLY_FILE
from gloc3.mission.model.waypoint_options import refuse_unkept
from gloc3_onboard.components.drivers.plan_flier import PlanControl, PlanFlier, PlanSettings
from gloc3_onboard.sensors.devices import GeoPath

WIDEST_M: Final = 255.0
"""Plane keeps the radius of a waypoint in a byte."""
ON_THE_GROUND: Final = (LandedState.ON_GROUND, LandedState.UNKNOWN)


class WingedPlanSettings(PlanSettings, frozen=True):
    """Settings of drivers for winged vehicles."""

    arm: bool = False
    """Whether it may arm the vehicle; the platform file's `arm` sets it."""
    cruise_m_s: Annotated[float, Bounds(1.0, 100.0)] = 23.0
    """Air speed of take-offs, and of returns home that name none."""
    comes_within_m: Annotated[float, Bounds(1.0, WIDEST_M)] = 30.0
    """Distance at which it turns to the next position, in metres; paths with smaller acceptance get this."""
    take_off_min_m: Annotated[float, Bounds(1.0, 1_000.0)] = 20.0
    """A take-off to less is refused: it circles there."""


W = TypeVar("W", bound=WingedPlanSettings)


class WingedFlier(PlanFlier[W], Generic[W]):
    """Mix-in of drivers that fly plans on wings: `take_off`, `return_home` and all that follows waypoints.

    A winged vehicle cannot follow a moving target: its autopilot flies lines between positions, and passes them.
    """

    performs: ClassVar = {
        "take_off": TakeOff,
        "follow_waypoints": FollowWaypointsOrder,
        "go_to": FollowWaypointsOrder,
        "fly_plan": FollowWaypointsOrder,
        FLY_FILE: FlyFileOrder,
        "return_home": ReturnHome,
    }

    home = Input(Home)

    def __init__(self, device: PlanControl) -> None:
        super().__init__(device)
        self._home_ned_m: Vector3 | None = None
        self._climbs = False

    def begin_action(
        self, capability: str, arguments: FollowWaypointsOrder | ReturnHome | TakeOff | FlyFileOrder, now_s: float
    ) -> None:
        """Starts the path; that of a take-off leads to its height over the present position."""
        if isinstance(arguments, FlyFileOrder):
            super().begin_action(capability, arguments, now_s)
            return
        if self._pose is None:
            raise Refused("there is no valid pose")
        match arguments:
            case TakeOff():
                order = self._climb_path(arguments, self._pose.position_ned_m)
            case ReturnHome():
                order = self._path_home(arguments, self._pose.position_ned_m)
            case _:
                order = arguments
        refuse_unkept(order, self.keeps, "what flies on wings")
        if order.heading.mode not in ("along", "hold"):
            raise Refused(f"a plane points where it flies: heading {order.heading.mode}")
        self._climbs = isinstance(arguments, TakeOff)
        within_m = min(max(order.acceptance_m, self._least_within_m), WIDEST_M)
        super().begin_action(capability, replace(order, acceptance_m=within_m), now_s)

    @property
    def _least_within_m(self) -> float:
        """So near it comes to places of ways that ask for less."""
        return self.settings.comes_within_m

    def _climb_path(self, arguments: TakeOff, place: Vector3) -> FollowWaypointsOrder:
        autopilot, least_m = self._autopilot, self.settings.take_off_min_m
        if autopilot is None or not autopilot.is_connected:
            raise Refused("the autopilot does not answer")
        if autopilot.is_armed and autopilot.landed not in ON_THE_GROUND:
            raise Refused("the vehicle is in the air already")
        if arguments.height_m < least_m:
            raise Refused(f"{arguments.height_m:g} m is too low to circle at: take off to {least_m:g} m or more")
        if not autopilot.is_armed and not self.settings.arm:
            raise Refused("the vehicle is not armed, and the platform file does not allow arming")
        if not autopilot.is_armed and not autopilot.is_armable:
            why = "; ".join([*autopilot.reasons, *autopilot.doubts]) or "it gives no reason"
            raise Refused(f"the autopilot would not arm: {why}")
        top = (place[0], place[1], place[2] - arguments.height_m)
        return FollowWaypointsOrder(waypoints_ned_m=(top,), speed_m_s=self.settings.cruise_m_s)

    def _path_home(self, arguments: ReturnHome, place: Vector3) -> FollowWaypointsOrder:
        if self._home_ned_m is None:
            raise Refused("home is not known")
        north, east, ground = self._home_ned_m
        down = place[2] if arguments.height_m is None else ground - arguments.height_m
        speed_m_s = arguments.speed_m_s or self.settings.cruise_m_s
        return FollowWaypointsOrder(waypoints_ned_m=((north, east, down),), speed_m_s=speed_m_s)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Uploads, starts, and follows the plan."""
        home = inbox.latest(self.home)
        self._home_ned_m = home.payload.position_ned_m if home is not None else self._home_ned_m
        return super().work(now_s, inbox)

    @property
    def _is_on_the_ground(self) -> bool:
        state = self._autopilot
        return state is not None and (not state.is_armed or state.landed in ON_THE_GROUND)

    def path(self, order: FollowWaypointsOrder, places: tuple[GeoPoint, ...]) -> GeoPath:
        """On wings; a take-off that was paused in the air is a way like any other."""
        is_from_ground = self._climbs and self._is_on_the_ground
        return super().path(order, places)._replace(heading_deg=None, is_winged=True, is_from_ground=is_from_ground)

    def manoeuvre(self, order: FollowWaypointsOrder) -> Manoeuvre:
        """It may be armed to take off only."""
        may_arm = self._climbs and self.settings.arm and self._is_on_the_ground
        return replace(super().manoeuvre(order), may_arm=may_arm)
