"""Arguments of a mission's actions: typed as written in the file, and as ordered from a component in NED.

An action's arguments are written in the mission's frame (`FollowWaypoints`) and handed to the component in NED
(`FollowWaypointsOrder`). Where nothing is a position, both are the same structure. Every package, ours too, brings its
kinds through the entry points `gloc3.capabilities`, which are subclasses of `Arguments`; see docs/add-a-capability.md.
"""

from bisect import bisect_left
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint
from math import radians
from typing import Annotated, Any, ClassVar, Final, Literal

import msgspec
from msgspec.structs import replace

from gloc3.errors import Gloc3Error, Misuse, Refused
from gloc3.installed import installed_points
from gloc3.messages.frames import Vector3
from gloc3.mission.model.legs import TRANSITION_S, Budget, FlightLeg, climb, fly, fly_by_form
from gloc3.mission.model.placement import Placement, written_for
from gloc3.mission.model.waypoint_options import KeptWallDistance, Planned, WaypointOptions, rest_s, with_options
from gloc3.platform.limits import Limits

Metres = Annotated[float, msgspec.Meta(ge=-100_000.0, le=100_000.0)]
Height = Annotated[float, msgspec.Meta(ge=-11_000.0, le=20_000.0)]
Latitude = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
LocalPosition = tuple[Metres, Metres, Height]
"""`[x, y, height]` in metres in a local frame."""
GeoPosition = tuple[Latitude, Longitude, Height]
"""`[latitude, longitude, height]` in degrees and metres."""
Speed = Annotated[float, msgspec.Meta(gt=0.0, le=50.0)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=86_400.0)]


DEFAULT_SPEED_M_S: Final = 1.0
"""Where neither the mission nor the platform says one."""


def speed_of(limits: Limits | None) -> float:
    """Default speed of paths."""
    if limits is None:
        return DEFAULT_SPEED_M_S
    return limits.survey_speed_m_s or min(DEFAULT_SPEED_M_S, limits.speed_m_s)


class Arguments(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Base of an action's arguments: its parameters, and its cost in resources, path, time and energy."""

    moves: ClassVar[bool] = False
    """Whether the action moves the vehicle, or keeps it in place on purpose."""
    resources: ClassVar[tuple[str, ...]] = ()
    """What it always needs for itself while it runs; a platform's row must claim them. `motion`, where it moves."""
    power_w: ClassVar[float] = 0.0
    """Consumption of its device while it runs, in addition to the vehicle's, in watts."""

    one_of: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Groups of arguments of which exactly one is required."""
    example: ClassVar[str] = "{}"
    """Example arguments in a mission file, in YAML, in a local frame."""

    def __post_init__(self) -> None:
        for group in self.one_of:
            given = sum(getattr(self, name) is not None for name in group)
            if given > 1:
                raise ValueError(f"only one of {' and '.join(group)} may be given")
            if not given:
                raise ValueError(f"{' or '.join(group)} must be given")

    @classmethod
    def claims(cls) -> tuple[str, ...]:
        """The resources, `motion` among them where it moves the vehicle."""
        return (*(("motion",) if cls.moves and "motion" not in cls.resources else ()), *cls.resources)

    @property
    def is_endless(self) -> bool:
        """Whether the action runs until it is ended from outside."""
        return False

    @property
    def begins_flight(self) -> bool:
        """Whether the vehicle sets off from the ground with it, for which it is armed."""
        return False

    @property
    def begins_with(self) -> str:
        """Its first part for people, such as an item of a plan; empty where its name says it all."""
        return ""

    @property
    def ends_flight(self) -> bool:
        """Whether the vehicle is on the ground and disarmed after it."""
        return False

    def filled(self, limits: Limits | None) -> "Arguments":
        """Arguments with the platform's defaults filled in; `limits` is None for an unknown platform.

        Raises:
            Refused: the platform's file does not define one.
        """
        del limits
        return self

    def order(self, placement: Placement) -> "Arguments":
        """The same in NED, as the component gets it.

        Raises:
            Refused: a position is written for another kind of frame.
        """
        del placement
        return self

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Path of the vehicle for an order; none for actions that do not move it."""
        del start_ned_m, budget
        return ()

    def time_needed_s(self, start_ned_m: Vector3, budget: Budget) -> float:
        """Duration of an order, as far as it ends without intervention."""
        return sum(leg.duration_s for leg in self.legs(start_ned_m, budget))


class LookAt(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A point to keep in front of the vehicle."""

    look_at: tuple[float, float, Height]
    """`[x, y, height]`, or `[latitude, longitude, height]` in frame geo."""


Degrees = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]
Heading = Literal["along", "hold"] | Degrees | LookAt
"""Along the path, unchanged, degrees clockwise from north (in every frame), or towards a point."""


class HeadingOrder(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Direction of the vehicle's nose, as a component gets it."""

    mode: Literal["along", "hold", "fixed", "look_at"] = "along"
    heading_rad: float = 0.0
    """With `fixed`: clockwise from north."""
    look_at_ned_m: Vector3 | None = None
    """With `look_at`: the point."""

    @property
    def follows_path(self) -> bool:
        """Whether a vehicle that points along its path can keep it."""
        return self.mode in ("along", "hold")


def heading_order(heading: Heading, placement: Placement) -> HeadingOrder:
    """A heading as written, in NED."""
    match heading:
        case "along" | "hold":
            return HeadingOrder(mode=heading)
        case LookAt(look_at=point):
            return HeadingOrder(mode="look_at", look_at_ned_m=placement.ned_from(point))
        case _:
            return HeadingOrder(mode="fixed", heading_rad=radians(heading))


class SetOff(Arguments, frozen=True, kw_only=True):
    """Common part of all departures: arm (where that is allowed), and be ready to move."""

    moves = True

    @property
    def begins_flight(self) -> bool:
        """It does."""
        return True


class TakeOff(SetOff, frozen=True, kw_only=True):
    """Arm (where that is allowed) and climb straight up."""

    example = "{height_m: 1.5}"

    height_m: Annotated[float, msgspec.Meta(gt=0.0, le=1_000.0)]
    """Height above the vehicle's position on the ground."""

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Straight up, and the seconds that arming takes."""
        north, east, _ = start_ned_m
        top = (north, east, budget.home_ned_m[2] - self.height_m)
        return (
            FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=budget.arming_s),
            climb(start_ned_m, top, budget),
        )


class DriveOff(SetOff, frozen=True, kw_only=True):
    """Arm (where allowed), on the ground or on the water, and wait for setpoints."""

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """The seconds that arming takes."""
        return (FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=budget.arming_s),)


class Dive(SetOff, frozen=True, kw_only=True):
    """Arm (where that is allowed) at the surface, and go straight down."""

    example = "{depth_m: 3}"

    depth_m: Annotated[float, msgspec.Meta(gt=0.0, le=11_000.0)]
    """Depth below the place where the vehicle floats."""

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """The seconds that arming takes, then straight down."""
        north, east, _ = start_ned_m
        deep = (north, east, budget.home_ned_m[2] + self.depth_m)
        return (
            FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=budget.arming_s),
            climb(start_ned_m, deep, budget),
        )


class LandOrder(Arguments, frozen=True, kw_only=True):
    """End the motion and disarm: come down, come up, or stop, whichever the vehicle does."""

    moves = True

    at_ned_m: Vector3 | None = None
    """The point to land at, whose height is ignored; None for the current position."""

    @property
    def ends_flight(self) -> bool:
        """It does."""
        return True

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """To above the place, then down to the height of home."""
        at = self.at_ned_m or start_ned_m
        above = (at[0], at[1], start_ned_m[2])
        return (*fly(start_ned_m, [above], budget.speed_m_s, 0.0, budget), _down(above, budget))


class Land(Arguments, frozen=True, kw_only=True):
    """End the motion and disarm, here or at a place: come down, come up, or stop, whichever the vehicle does."""

    moves = True

    at_m: tuple[Metres, Metres] | None = None
    """`[x, y]` of the place, in a local frame."""
    at: tuple[Latitude, Longitude] | None = None
    """`[latitude, longitude]` of the place, in frame geo."""

    def order(self, placement: Placement) -> LandOrder:
        """The place in NED."""
        at = written_for(placement, self.at_m, self.at, "at")
        return LandOrder(at_ned_m=None if at is None else placement.ned_from((*at, 0.0)))


class Hold(Arguments, frozen=True, kw_only=True):
    """Keep position."""

    moves = True
    example = "{duration_s: 10}"

    duration_s: Seconds | None = None
    """Duration; None to hold until it is ended."""

    @property
    def is_endless(self) -> bool:
        """Without a duration it is."""
        return self.duration_s is None

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Staying where it is."""
        del budget
        return (FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=self.duration_s or 0.0),)


class VtolTransition(Arguments, frozen=True, kw_only=True):
    """Go over to wings, straight ahead, and circle there; or to rotors, and hover where that ends."""

    moves = True
    example = "{to: wings}"

    to: Literal["wings", "rotors"]

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Where ahead is, is not known before: it is counted as staying where it is."""
        del budget
        return (FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=TRANSITION_S),)


LONGEST_BY_HAND_S: Final = 1800.0
"""Default limit of manual control without a stated duration."""
COUNTED_BY_HAND_S: Final = 60.0
"""So much of it is counted in the estimate."""


class Teleoperate(Arguments, frozen=True, kw_only=True):
    """Have an operator steer by hand: velocities from the station, each good for half a second, then it keeps its place."""

    moves = True
    example = "{duration_s: 60}"

    duration_s: Seconds | None = None
    """Afterwards it is done, and the vehicle keeps its place; None for half an hour at most, of which a minute is counted before: an
    operator ends it, or a low battery does."""
    speed_m_s: Speed | None = None
    """No faster than that in any direction; None for the platform's limits."""
    yaw_rate_deg_s: Annotated[float, msgspec.Meta(gt=0.0, le=90.0)] = 20.0
    """No faster turning than that."""

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Where it goes is not known before: it is counted as staying where it is."""
        del budget
        duration_s = COUNTED_BY_HAND_S if self.duration_s is None else self.duration_s
        return (FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=duration_s),)


class ReturnHome(Arguments, frozen=True, kw_only=True):
    """Fly to above the place where the vehicle was armed, and stay there."""

    moves = True

    height_m: Annotated[float, msgspec.Meta(gt=0.0, le=1_000.0)] | None = None
    """Height above home to fly at, reached first; None for the present height."""
    speed_m_s: Speed | None = None
    """None for the platform's limit."""

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Up or down to the height, then straight home."""
        north, east, down = start_ned_m
        home = budget.home_ned_m
        height_down = down if self.height_m is None else home[2] - self.height_m
        way = [(north, east, height_down), (home[0], home[1], height_down)]
        return fly_by_form(start_ned_m, way, self.speed_m_s, 0.0, budget)


class FollowWaypointsOrder(WaypointOptions, Arguments, frozen=True, kw_only=True):
    """Fly through positions in their order."""

    moves = True

    waypoints_ned_m: tuple[Vector3, ...]
    speed_m_s: float
    heading: HeadingOrder = HeadingOrder()
    wall_distance_m: KeptWallDistance = None
    """Keep so far from the wall ahead."""
    plan: Planned = False
    """Find a way around what is known, in place of the straight one."""
    between: tuple[int, ...] = ()
    """Indices of waypoints that are none of the mission, and follow the ground between two of them."""

    def number_of(self, index: int) -> int:
        """Index, in the mission, of a waypoint of the path; of one between two, that of the second."""
        return index - bisect_left(self.between, index)

    @property
    def rest_s(self) -> float:
        """How long the vehicle stays at each waypoint."""
        return rest_s(self)

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Straight from waypoint to waypoint."""
        return fly_by_form(start_ned_m, self.waypoints_ned_m, self.speed_m_s, self.rest_s, budget, self.by)


class _Flight(WaypointOptions, Arguments, frozen=True, kw_only=True):
    """What every flight to positions takes."""

    moves = True

    speed_m_s: Speed | None = None
    """None: the platform's `survey_speed_m_s`."""
    heading: Heading = "along"
    """`along`, `hold`, degrees clockwise from north, or `{look_at: POSITION}`."""

    def filled(self, limits: Limits | None) -> Arguments:
        """With the platform's speed where the mission says none."""
        return self if self.speed_m_s is not None else replace(self, speed_m_s=speed_of(limits))

    def _order(self, waypoints: tuple[Vector3, ...] | None, placement: Placement, name: str) -> FollowWaypointsOrder:
        if waypoints is None:
            raise Refused(f"{name if placement.is_geo else name + '_m'} is missing")
        points_ned_m, between = placement.path_from(waypoints)
        if between and rest_s(self):
            raise Refused(
                "hold_s would stop at the places that follow the ground, too; use go_to and hold for each stop"
            )
        order = FollowWaypointsOrder(
            waypoints_ned_m=points_ned_m,
            speed_m_s=self.speed_m_s or DEFAULT_SPEED_M_S,
            heading=heading_order(self.heading, placement),
            between=between,
        )
        return with_options(order, self)


class FollowWaypoints(_Flight, frozen=True, kw_only=True):
    """Fly through positions in their order."""

    one_of = (("waypoints_m", "waypoints"),)
    example = "{waypoints_m: [[2, 1, 2], [8, 1, 2]], speed_m_s: 0.5}"

    waypoints_m: Annotated[tuple[LocalPosition, ...], msgspec.Meta(min_length=1, max_length=10_000)] | None = None
    """`[x, y, height]` each, in a local frame."""
    waypoints: Annotated[tuple[GeoPosition, ...], msgspec.Meta(min_length=1, max_length=10_000)] | None = None
    """`[latitude, longitude, height]` each, in frame geo."""
    wall_distance_m: KeptWallDistance = None
    """Keep this distance from the wall that the vehicle faces: the path is shifted by up to 1.5 m. Its heading should
    be across the path (degrees, or `look_at`); it needs a laser scanner."""

    def order(self, placement: Placement) -> FollowWaypointsOrder:
        """The waypoints in NED."""
        waypoints = written_for(placement, self.waypoints_m, self.waypoints, "waypoints")
        return self._order(waypoints, placement, "waypoints")


class GoTo(_Flight, frozen=True, kw_only=True):
    """Fly straight to a position; the component gets it as `FollowWaypointsOrder` with one waypoint."""

    one_of = (("position_m", "position"),)
    example = "{position_m: [2, 1, 2]}"

    position_m: LocalPosition | None = None
    """`[x, y, height]`, in a local frame."""
    position: GeoPosition | None = None
    """`[latitude, longitude, height]`, in frame geo."""
    plan: Planned = False
    """Find a way around what the map shows, and another one where something is in it; for vehicles with a scanner. The
    estimate counts the straight way."""

    def order(self, placement: Placement) -> FollowWaypointsOrder:
        """The position in NED, as a path with one waypoint."""
        position = written_for(placement, self.position_m, self.position, "position")
        return self._order(None if position is None else (position,), placement, "position")


class Wait(Arguments, frozen=True, kw_only=True):
    """Let time pass; carried out by the executor itself, without a component."""

    example = "{duration_s: 5}"

    duration_s: Seconds

    def time_needed_s(self, start_ned_m: Vector3, budget: Budget) -> float:
        """The requested duration."""
        del start_ned_m, budget
        return self.duration_s


def _down(start_ned_m: Vector3, budget: Budget) -> FlightLeg:
    """Straight down to the height of home, at the landing speed."""
    end = (start_ned_m[0], start_ned_m[1], budget.home_ned_m[2])
    duration_s = abs(end[2] - start_ned_m[2]) / budget.landing_m_s + budget.disarming_s
    return FlightLeg(start=start_ned_m, end=end, duration_s=duration_s)


@cache
def argument_kinds() -> Mapping[str, type[Arguments]]:
    """All kinds of arguments by name, of all installed packages (entry points `gloc3.capabilities`).

    Raises:
        Gloc3Error: a package's entry point cannot be loaded.
        Misuse: one is no subclass of `Arguments`, two packages use one name, or ours are not there.
    """
    kinds: dict[str, type[Arguments]] = {}
    for point in installed_points("gloc3.capabilities"):
        found = _loaded(point)
        if kinds.setdefault(point.name, found) is not found:
            raise Misuse(f"two packages define arguments called {point.name!r}")
    if "wait" not in kinds:
        raise Misuse("the installed gloc3 is older than its source and has no capabilities: install it again")
    return kinds


def _loaded(point: EntryPoint) -> type[Arguments]:
    try:
        found: Any = point.load()
    except (ImportError, AttributeError) as error:
        raise Gloc3Error(f"entry point {point.name} of gloc3.capabilities cannot be loaded: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Arguments)):
        raise Misuse(f"entry point {point.name} of gloc3.capabilities is not a subclass of Arguments")
    return found
