"""Foreign missions in MAVLink terms: items with frames and parameters, fence areas, rally points."""

from typing import Any, Final

import msgspec

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
    """A mission file of another program."""

    entries: tuple[PlanEntry, ...]
    fence: tuple[FenceArea, ...] = ()
    rally: tuple[tuple[float, float, float], ...] = ()
    """Latitude, longitude and altitude."""
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

    @property
    def items(self) -> tuple[MavItem, ...]:
        """All items, complex ones expanded."""
        return tuple(item for entry in self.entries for item in entry.items)

    def fence_items(self) -> tuple[MavItem, ...]:
        """The fence as the items of a MAVLink fence transfer."""
        found: list[MavItem] = []
        for area in self.fence:
            if area.center is not None:
                command = 5003 if area.is_inclusion else 5004
                params = (area.radius_m, 0.0, 0.0, 0.0)
                found.append(MavItem(command=command, frame=0, params=params, x=area.center[0], y=area.center[1]))
            command = 5001 if area.is_inclusion else 5002
            params = (float(len(area.polygon)), 0.0, 0.0, 0.0)
            found += [MavItem(command=command, frame=0, params=params, x=lat, y=lon) for lat, lon in area.polygon]
        return tuple(found)

    def rally_items(self) -> tuple[MavItem, ...]:
        """The rally points as the items of a MAVLink rally transfer."""
        return tuple(MavItem(command=5100, frame=3, x=lat, y=lon, z=height) for lat, lon, height in self.rally)
