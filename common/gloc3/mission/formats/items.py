"""Foreign missions in MAVLink terms: items with frames and parameters, fence areas, rally points."""

from collections.abc import Sequence
from typing import Any, Final

import msgspec

from gloc3.errors import Finding, Refused
from gloc3.mission.formats.commands import (
    CIRCLE_IN,
    CIRCLE_OUT,
    POLYGON_IN,
    POLYGON_OUT,
    RALLY,
    RETURN_POINT,
    command_name,
)

MULTIROTORS: Final = (2, 3, 4, 13, 14, 15, 29, 35)
"""MAV_TYPE of vehicles that hover: quadrotor, coaxial, helicopter, hexa-, octo-, tri-, dodeca- and decarotor."""


class MavItem(msgspec.Struct, frozen=True, kw_only=True):
    """One item of a MAVLink mission."""

    command: int
    """MAV_CMD."""
    frame: int
    """MAV_FRAME."""
    params: tuple[float | None, float | None, float | None, float | None] = (0.0, 0.0, 0.0, 0.0)
    """param1 to param4; None is NaN, *not given*."""
    x: float | None = 0.0
    """Latitude in degrees, or param5."""
    y: float | None = 0.0
    """Longitude in degrees, or param6."""
    z: float | None = 0.0
    """Altitude in metres above the frame's reference, or param7."""
    is_continued: bool = True
    """Whether the next item follows automatically."""
    is_current: bool = False

    @property
    def has_position(self) -> bool:
        """Whether it names a position; a latitude and longitude of 0 mean the present one."""
        return bool(self.x or self.y)


class PlanEntry(msgspec.Struct, frozen=True, kw_only=True):
    """An entry of a file: a simple item, or a complex one with the items that it stands for."""

    items: tuple[MavItem, ...]
    raw: dict[str, Any] | None = None
    """As read from the file, for writing it back without loss."""


class FenceArea(msgspec.Struct, frozen=True, kw_only=True):
    """A polygon or circle to stay in, or out of."""

    is_inclusion: bool
    polygon: tuple[tuple[float, float], ...] = ()
    """Latitudes and longitudes in degrees."""
    center: tuple[float, float] | None = None
    radius_m: float = 0.0


class ForeignPlan(msgspec.Struct, frozen=True, kw_only=True):
    """A mission file of another program, or a file of fences or rally points alone."""

    entries: tuple[PlanEntry, ...] = ()
    fence: tuple[FenceArea, ...] = ()
    fence_return: tuple[float, float] | None = None
    """Where ArduPilot returns to after a breach of the fence: latitude and longitude."""
    rally: tuple[tuple[float, float, float], ...] = ()
    """Latitude, longitude and altitude above home."""
    home: tuple[float, float, float] | None = None
    """Planned home: latitude, longitude, altitude above mean sea level."""
    cruise_speed_m_s: float | None = None
    hover_speed_m_s: float | None = None
    firmware_type: int | None = None
    """MAV_AUTOPILOT."""
    vehicle_type: int | None = None
    """MAV_TYPE."""
    raw: dict[str, Any] | None = None
    """What else the file holds, for writing it back without loss."""
    lines: tuple[int, ...] = ()
    """Line in the file of each item; empty where the items are from no file."""
    findings: tuple[Finding, ...] = ()
    """Warnings of the reader: what the file holds and the plan does not."""

    @property
    def items(self) -> tuple[MavItem, ...]:
        """All items, complex ones expanded; home is not among them."""
        return tuple(item for entry in self.entries for item in entry.items)

    @property
    def is_from_waypoints(self) -> bool:
        """Whether it has no other form than MAVLink's items: from a file of waypoints, or from the wire."""
        return self.raw is None

    @property
    def content(self) -> "ForeignPlan":
        """What it says, without where and how it was written: equal for two files of the same plan."""
        return msgspec.structs.replace(self, lines=(), findings=())

    def line_of(self, number: int) -> int:
        """Line in the file of an item, from 1 for the first item; 0 where it is not known."""
        return self.lines[number - 1] if 0 < number <= len(self.lines) else 0

    def fence_items(self) -> tuple[MavItem, ...]:
        """The fence as the items of a MAVLink fence transfer."""
        found: list[MavItem] = []
        if self.fence_return is not None:
            found.append(MavItem(command=RETURN_POINT, frame=0, x=self.fence_return[0], y=self.fence_return[1]))
        for area in self.fence:
            if area.center is not None:
                command = CIRCLE_IN if area.is_inclusion else CIRCLE_OUT
                params = (area.radius_m, 0.0, 0.0, 0.0)
                found.append(MavItem(command=command, frame=0, params=params, x=area.center[0], y=area.center[1]))
            command = POLYGON_IN if area.is_inclusion else POLYGON_OUT
            params = (float(len(area.polygon)), 0.0, 0.0, 0.0)
            found += [MavItem(command=command, frame=0, params=params, x=lat, y=lon) for lat, lon in area.polygon]
        return tuple(found)

    def rally_items(self) -> tuple[MavItem, ...]:
        """The rally points as the items of a MAVLink rally transfer."""
        return tuple(MavItem(command=RALLY, frame=3, x=lat, y=lon, z=height) for lat, lon, height in self.rally)


class FenceParts(msgspec.Struct, frozen=True, kw_only=True):
    """The fence of a MAVLink fence transfer."""

    areas: tuple[FenceArea, ...] = ()
    return_point: tuple[float, float] | None = None


def fence_parts(items: Sequence[MavItem]) -> FenceParts:
    """The areas and the return point in the items of a fence transfer.

    Raises:
        Refused: an item does not belong to a fence, or a polygon is not complete.
    """
    areas: list[FenceArea] = []
    return_point: tuple[float, float] | None = None
    index = 0
    while index < len(items):
        item = items[index]
        command, size, place = item.command, item.params[0] or 0.0, (item.x or 0.0, item.y or 0.0)
        if command == RETURN_POINT:
            return_point = place
            index += 1
            continue
        if command in (CIRCLE_IN, CIRCLE_OUT):
            areas.append(FenceArea(is_inclusion=command == CIRCLE_IN, center=place, radius_m=size))
            index += 1
            continue
        corners = items[index : index + int(size)]
        if command not in (POLYGON_IN, POLYGON_OUT) or not 3 <= size == len(corners):
            raise Refused(f"fence item {index} ({command_name(command)}) is not understood")
        if any((corner.command, corner.params[0]) != (command, item.params[0]) for corner in corners):
            raise Refused(f"fence item {index} starts an incomplete polygon")
        polygon = tuple((corner.x or 0.0, corner.y or 0.0) for corner in corners)
        areas.append(FenceArea(is_inclusion=command == POLYGON_IN, polygon=polygon))
        index += len(corners)
    return FenceParts(areas=tuple(areas), return_point=return_point)


def rally_points(items: Sequence[MavItem]) -> tuple[tuple[float, float, float], ...]:
    """The points in the items of a rally transfer.

    Raises:
        Refused: an item is no rally point.
    """
    for number, item in enumerate(items):
        if item.command != RALLY:
            raise Refused(f"rally point {number} ({command_name(item.command)}) is not understood")
    return tuple((item.x or 0.0, item.y or 0.0, item.z or 0.0) for item in items)
