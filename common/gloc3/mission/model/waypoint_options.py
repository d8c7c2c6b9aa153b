"""Waypoint options: each is declared once, for reader, schema, estimate, checks and components.

To add one, add a field to `WaypointOptions` here, and its name to `keeps` of each component that supports it. Missions
can then use it in `follow_waypoints` and `go_to`. It is sent in the order, its stops count in the estimate and the
check of turns, and components that do not support it refuse it, before and during the flight.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from gloc3.errors import Refused


class WaypointOption(NamedTuple):
    """Properties of an option beside its type and bounds."""

    unkept: str
    """Text for a component that does not support the option: `keeps no height over the ground`."""
    is_in_plans: bool = False
    """Whether a plan of an autopilot can say it."""
    rest_s: Callable[[Any], float] = lambda _: 0.0
    """How long a value has the vehicle stay at each waypoint."""


Acceptance = Annotated[
    float,
    msgspec.Meta(gt=0.0, le=1_000.0),
    WaypointOption("cannot set an acceptance radius", is_in_plans=True),
]
HoldTime = Annotated[
    float,
    msgspec.Meta(ge=0.0, le=86_400.0),
    WaypointOption("cannot hold at waypoints", is_in_plans=True, rest_s=float),
]
Altitude = Annotated[float, msgspec.Meta(ge=0.3, le=200.0)]
"""Over the ground or the floor of the water; as far as range finders see."""
KeptAltitude = Annotated[Altitude | None, WaypointOption("cannot hold a height above ground")]
WallDistance = Annotated[float, msgspec.Meta(ge=1.2, le=6.0)]
"""At least the distance that the limiter keeps from obstacles, at most the range in which a wall is searched."""
KeptWallDistance = Annotated[WallDistance | None, WaypointOption("cannot keep a distance from a wall")]

Planned = Annotated[bool, WaypointOption("cannot plan a way around obstacles")]

CarriedBy = Annotated[Literal["wings", "rotors"] | None, WaypointOption("has no choice between wings and rotors")]

S = TypeVar("S", bound=msgspec.Struct)


class WaypointOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Options of every path through waypoints, in a mission and in the order that a component gets."""

    acceptance_m: Acceptance = 0.25
    """A waypoint counts as passed within this distance; where a mission says none, the platform's `survey_acceptance_m`."""
    hold_s: HoldTime = 0.0
    """Time to stay at each waypoint."""
    by: CarriedBy = None
    """Of what has both, `wings` or `rotors`; None: wings where the way is longer than two transitions."""
    altitude_m: KeptAltitude = None
    """Keep this height above the ground or the sea bed, by the downward range finder. The height of the first waypoint
    applies until the range finder has a measurement; the other heights are ignored."""


@cache
def options_of(kind: type[msgspec.Struct]) -> Mapping[str, WaypointOption]:
    """The options that a structure has, by field."""
    return {
        name: part
        for name, hint in get_type_hints(kind, include_extras=True).items()
        for part in (get_args(hint) if get_origin(hint) is Annotated else ())
        if isinstance(part, WaypointOption)
    }


def with_options(path: S, written: msgspec.Struct) -> S:
    """A path with the options of another structure, as far as both have them."""
    shared = options_of(type(path)).keys() & options_of(type(written)).keys()
    return msgspec.structs.replace(path, **{name: getattr(written, name) for name in sorted(shared)})


def given_options(path: msgspec.Struct) -> Iterator[tuple[str, WaypointOption]]:
    """Options of a path that differ from their defaults."""
    defaults = {field.name: field.default for field in msgspec.structs.fields(type(path))}
    for name, option in options_of(type(path)).items():
        if getattr(path, name) != defaults[name]:
            yield name, option


def rest_s(path: msgspec.Struct) -> float:
    """How long the vehicle stays at each waypoint."""
    return sum(option.rest_s(getattr(path, name)) for name, option in options_of(type(path)).items())


def refuse_unkept(path: msgspec.Struct, keeps: frozenset[str], who: str) -> None:
    """Refuses options that a component does not support.

    Raises:
        Refused: the path has one.
    """
    for name, option in given_options(path):
        if name not in keeps:
            raise Refused(f"{who} {option.unkept}")


IN_PLANS: Final = frozenset(name for name, option in options_of(WaypointOptions).items() if option.is_in_plans)
"""What plans of autopilots can say."""
