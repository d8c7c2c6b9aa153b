"""Placement of a mission on Earth: the only place that turns its positions into NED."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple, Protocol, TypeVar

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint, LocalFrame, TangentPlane, Vector3

T = TypeVar("T")

Point = tuple[float, float]
"""Two horizontal coordinates: x and y, or latitude and longitude, or north and east, as the name of the value says."""


class HeightAbove(StrEnum):
    """Reference of the heights of a mission in `frame: geo`."""

    HOME = "home"
    """The height at which the vehicle stood when it was armed."""
    SEA = "sea"
    """Mean sea level."""
    GROUND = "ground"
    """The ground below, by terrain tiles; without them such a mission is refused."""


class PlacedPath(NamedTuple):
    """A path in NED."""

    points_ned_m: tuple[Vector3, ...]
    between: tuple[int, ...] = ()
    """Indices of the places that only follow the ground between two waypoints of the mission."""


class Placement(Protocol):
    """Converts positions as written in a mission to NED in metres.

    The origin of NED is that of the vehicle's pose.
    """

    is_geo: bool
    """Whether positions are `[latitude, longitude, height]`, else `[x, y, height]`."""
    counts_from_sea: bool
    """Whether heights are altitudes above the sea."""

    def ned_from(self, position: Vector3) -> Vector3:
        """The NED position of a position of the mission."""

    def path_from(self, positions: Sequence[Vector3]) -> PlacedPath:
        """The path through positions of the mission."""

    def height_from(self, height_m: float) -> float:
        """The height above the origin of NED of a height of the mission."""


class LocalPlacement:
    """Positions `[x, y, height]` in metres in a local frame."""

    is_geo = False
    counts_from_sea = False

    def __init__(self, frame: LocalFrame, origin: GeoPoint | None = None) -> None:
        """A placement.

        Args:
            frame: the mission's frame.
            origin: the origin of NED; None for that of the frame.
        """
        self._frame = frame
        self._plane = None if origin is None or origin == frame.origin else TangentPlane(origin)

    def ned_from(self, position: Vector3) -> Vector3:
        """The NED position of `[x, y, height]`."""
        if self._plane is None:
            return self._frame.to_ned(position)
        return self._plane.ned_from_geo(*self._frame.to_geo(position))

    def path_from(self, positions: Sequence[Vector3]) -> PlacedPath:
        """Straight from position to position."""
        return PlacedPath(tuple(map(self.ned_from, positions)))

    def height_from(self, height_m: float) -> float:
        """The height above the origin of NED, at the origin of the frame."""
        return -self.ned_from((0.0, 0.0, height_m))[2]


class GeoPlacement:
    """Positions `[latitude, longitude, height]` in degrees and metres."""

    is_geo = True

    def __init__(self, origin: GeoPoint, height_above: HeightAbove, home_altitude_m: float | None = None) -> None:
        """A placement.

        Args:
            origin: the origin of NED.
            height_above: what heights are counted from.
            home_altitude_m: altitude above the sea of the vehicle when it was armed; None for that of the origin.
        """
        self._plane = TangentPlane(origin)
        home_m = origin.altitude_m if home_altitude_m is None else home_altitude_m
        self.counts_from_sea = height_above is HeightAbove.SEA
        self._zero_altitude_m = 0.0 if height_above is HeightAbove.SEA else home_m

    def ned_from(self, position: Vector3) -> Vector3:
        """The NED position of `[latitude, longitude, height]`."""
        latitude, longitude, height = position
        return self._plane.ned_from_geo(latitude, longitude, height + self._zero_altitude_m)

    def path_from(self, positions: Sequence[Vector3]) -> PlacedPath:
        """Straight from position to position."""
        return PlacedPath(tuple(map(self.ned_from, positions)))

    def height_from(self, height_m: float) -> float:
        """The height above the origin of NED, at that origin."""
        return height_m + self._zero_altitude_m - self._plane.origin.altitude_m


def written_for(placement: Placement, local: T | None, geo: T | None, name: str) -> T | None:
    """Selects the form of a position that the mission's frame requires: `NAME_m` in a local frame, `NAME` in geo.

    Raises:
        Refused: the other form is given.
    """
    right, wrong = (geo, local) if placement.is_geo else (local, geo)
    if wrong is not None:
        if placement.is_geo:
            raise Refused(f"{name}_m is for local frames; frame geo uses {name} in [latitude, longitude, height]")
        raise Refused(f"{name} is for frame geo; a local frame uses {name}_m in [x, y, height]")
    return right
