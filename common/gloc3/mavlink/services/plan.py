"""Data of the mission protocol: plans of three types, their items, and results of transfers."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, TypeAlias

import msgspec

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage

ALL_TYPES: Final = 255
"""MAV_MISSION_TYPE_ALL, for clearing only."""
_GLOBAL_FRAMES: Final = frozenset({0, 3, 5, 6, 10, 11})
FRAME_MISSION: Final = 2
"""MAV_FRAME_MISSION: of items without a place."""


class PlanType(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class PlanItem(msgspec.Struct, frozen=True, kw_only=True):
    """One item of a plan, as on the wire; its number is its position in the plan."""

    command: int
    """MAV_CMD."""
    frame: int = 0
    """MAV_FRAME."""
    is_current: bool = False
    autocontinue: bool = True
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int = 0
    """Latitude in 1e-7 degrees, or local x in 1e-4 m."""
    y: int = 0
    """Longitude in 1e-7 degrees, or local y in 1e-4 m."""
    z: float = 0.0
    """Altitude in metres, as the frame says."""

    def message(self, number: int, kind: int, target: Address) -> MavlinkMessage:
        """MISSION_ITEM_INT."""
        return self._message("MISSION_ITEM_INT", self.x, self.y, number, kind, target)

    def float_message(self, number: int, kind: int, target: Address) -> MavlinkMessage:
        """MISSION_ITEM, for clients that support nothing else; its precision is only about a metre."""
        per_unit = units_per_degree(self.frame)
        return self._message("MISSION_ITEM", self.x / per_unit, self.y / per_unit, number, kind, target)

    def _message(self, name: str, x: float, y: float, number: int, kind: int, target: Address) -> MavlinkMessage:
        return make(
            name,
            target_system=target.system,
            target_component=target.component,
            seq=number,
            mission_type=kind,
            command=self.command,
            frame=self.frame,
            current=int(self.is_current),
            autocontinue=int(self.autocontinue),
            param1=self.param1,
            param2=self.param2,
            param3=self.param3,
            param4=self.param4,
            x=x,
            y=y,
            z=self.z,
        )


Plan: TypeAlias = tuple[PlanItem, ...]


def read_item(message: MavlinkMessage) -> PlanItem:
    """Reads the item of a MISSION_ITEM_INT, or of a deprecated MISSION_ITEM."""
    x, y = message.x, message.y
    if message.name == "MISSION_ITEM":
        per_unit = units_per_degree(message.frame)
        x, y = (_whole(value * per_unit) for value in (x, y))
    return PlanItem(
        command=message.command,
        frame=message.frame,
        is_current=message.current == 1,
        autocontinue=message.autocontinue != 0,
        param1=message.param1,
        param2=message.param2,
        param3=message.param3,
        param4=message.param4,
        x=x,
        y=y,
        z=message.z,
    )


def _whole(value: float) -> int:
    """The nearest number that the wire can hold."""
    return round(max(-(2.0**31), min(2.0**31 - 1.0, value))) if math.isfinite(value) else 0


def units_per_degree(frame: int) -> float:
    """Wire units per degree of a global frame, per metre of a local one, or per unit of a frame without a position."""
    return 1e7 if frame in _GLOBAL_FRAMES else 1.0 if frame == FRAME_MISSION else 1e4


class PlanResult(IntEnum):
    """Results of transfers: MAV_MISSION_RESULT, and ends that have no message."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7_Z = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    CANCELLED = 15
    OTHER = 253
    """A result that this version does not define."""
    TOO_MANY_LOSSES = 254
    """The other end is alive, but the transfer was given up after too many losses."""
    NO_ANSWER = 255
    """The other end has stopped answering, or never answered."""

    @property
    def words(self) -> str:
        """For a person."""
        return _WORDS.get(self, self.name.lower().replace("_", " "))

    @classmethod
    def read(cls, number: int) -> PlanResult:
        """Result of a MISSION_ACK."""
        return cls(number) if number <= cls.CANCELLED else cls.OTHER


ITEM_REFUSALS: Final = frozenset(
    {PlanResult.UNSUPPORTED_FRAME, PlanResult.UNSUPPORTED}
    | {result for result in PlanResult if PlanResult.INVALID <= result <= PlanResult.INVALID_PARAM7_Z}
)
"""Results that are about the item which was sent last."""
_WORDS: Final = {
    PlanResult.ERROR: "the other end failed",
    PlanResult.UNSUPPORTED_FRAME: "an item's frame is not supported",
    PlanResult.UNSUPPORTED: "an item's command, or this type of plan, is not supported",
    PlanResult.NO_SPACE: "the plan has too many items",
    PlanResult.INVALID: "an item has an invalid value",
    PlanResult.INVALID_SEQUENCE: "an item came out of sequence",
    PlanResult.DENIED: "the other end accepts no plan from us now",
    PlanResult.TOO_MANY_LOSSES: "gave up after repeated packet loss",
    PlanResult.NO_ANSWER: "no answer",
}
