"""Conversion of plan items between files (degrees and metres) and the mission protocol's wire format."""

import math
import struct
from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.services.plan import FRAME_MISSION, PlanItem, units_per_degree
from gloc3.mission.formats.commands import COMMANDS, JUMP, WAYPOINT
from gloc3.mission.formats.items import MavItem

_INT_MAX: Final = 2**31 - 1


def to_wire(item: MavItem, where: str, *, is_current: bool = False) -> PlanItem:
    """Encodes an item for sending: numbers in single precision, positions in the integer units of the frame.

    Args:
        item: as in a file.
        where: its name in a refusal.
        is_current: whether the plan starts at it.

    Raises:
        Refused: a number is out of the wire's range.
    """
    p1, p2, p3, p4 = (_single(param, where) for param in item.params)
    scale = units_per_degree(item.frame)
    return PlanItem(
        command=item.command,
        frame=item.frame,
        is_current=is_current,
        autocontinue=item.is_continued,
        param1=p1,
        param2=p2,
        param3=p3,
        param4=p4,
        x=_whole(item.x, scale, where),
        y=_whole(item.y, scale, where),
        z=_single(item.z or 0.0, where),
    )


def mission_to_wire(
    items: Sequence[MavItem], home: tuple[float, float, float] | None, *, has_home: bool
) -> tuple[PlanItem, ...]:
    """The items of a mission as an autopilot wants them.

    PX4 takes what names no place in the frame for that alone; files of waypoints give such items a frame of places, too.

    Args:
        items: as in a file, whose jumps name them as if home were item 0.
        home: as in a file.
        has_home: whether the autopilot keeps home as item 0, as ArduPilot does.

    Raises:
        Refused: a number is out of the wire's range; with the item.
    """
    sent = list(items)
    if has_home and sent:
        x, y, z = home or (0.0, 0.0, 0.0)
        sent.insert(0, MavItem(command=WAYPOINT, frame=0, x=x, y=y, z=z))
    elif not has_home:
        sent = [_in_its_frame(jump_moved(item, -1)) for item in sent]
    return tuple(to_wire(item, f"item {number}", is_current=number == 0) for number, item in enumerate(sent))


def jump_moved(item: MavItem, by: int) -> MavItem:
    """A jump to an item that is numbered otherwise; other items are left as they are."""
    target = item.params[0]
    if item.command != JUMP or target is None:
        return item
    return msgspec.structs.replace(item, params=(target + by, *item.params[1:]))


def _in_its_frame(item: MavItem) -> MavItem:
    known = COMMANDS.get(item.command)
    if known is None or known.goes_to or (known.has_position and (item.x or item.y)):
        return item
    return msgspec.structs.replace(item, frame=FRAME_MISSION)


def from_wire(item: PlanItem) -> MavItem:
    """An item as a file has it."""
    scale = units_per_degree(item.frame)
    values = (item.param1, item.param2, item.param3, item.param4)
    p1, p2, p3, p4 = (None if math.isnan(value) else value for value in values)
    return MavItem(
        command=item.command,
        frame=item.frame,
        params=(p1, p2, p3, p4),
        x=item.x / scale,
        y=item.y / scale,
        z=None if math.isnan(item.z) else item.z,
        is_continued=item.autocontinue,
        is_current=item.is_current,
    )


def _single(value: float | None, where: str) -> float:
    if value is None:
        return math.nan
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        raise Refused(f"{where}: {value:g} does not fit the wire") from None


def _whole(value: float | None, scale: float, where: str) -> int:
    number = round((value or 0.0) * scale)
    if abs(number) > _INT_MAX:
        raise Refused(f"{where}: {value:g} does not fit the wire")
    return number
