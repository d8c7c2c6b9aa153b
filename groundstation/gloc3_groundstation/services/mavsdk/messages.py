"""Messages between the station and its MAVSDK process over a pipe: length, then msgpack."""

from enum import StrEnum
from typing import Final, TypeAlias

import msgspec

from gloc3.errors import Gloc3Error

LENGTH_BYTES: Final = 4
LARGEST_BYTES: Final = 1_000_000


class Plugin(StrEnum):
    """What MAVSDK is asked for, by its own names of plugin and method."""

    ARM = "action.arm"
    DISARM = "action.disarm"
    TAKE_OFF = "action.takeoff"
    GO_TO = "action.goto_location"
    SPEED = "action.set_current_speed"
    REBOOT = "action.reboot"
    START_PLAN = "mission_raw.start_mission"


class LinkReceived(msgspec.Struct, frozen=True, tag=True):
    """To the process: frames of the vehicle."""

    data: bytes


class Act(msgspec.Struct, frozen=True, tag=True):
    """To the process: command the vehicle."""

    number: int
    plugin: Plugin
    arguments: tuple[float, ...] = ()
    """As the method takes them; of a take-off the height above home in metres."""


class LinkSent(msgspec.Struct, frozen=True, tag=True):
    """From the process: frames that MAVSDK sends."""

    data: bytes


class Ready(msgspec.Struct, frozen=True, tag=True):
    """From the process: MAVSDK runs and takes frames."""


class Done(msgspec.Struct, frozen=True, tag=True):
    """From the process: a command was accepted."""

    number: int


class Failed(msgspec.Struct, frozen=True, tag=True):
    """From the process: a command was not accepted."""

    number: int
    reason: str


ToProcess: TypeAlias = LinkReceived | Act
FromProcess: TypeAlias = LinkSent | Ready | Done | Failed

_encode = msgspec.msgpack.Encoder().encode
to_process: Final = msgspec.msgpack.Decoder(ToProcess)
from_process: Final = msgspec.msgpack.Decoder(FromProcess)


class PipeError(Gloc3Error):
    """The other end of the pipe does not speak as agreed."""


def packed(message: ToProcess | FromProcess) -> bytes:
    """A message with its length before it."""
    data = _encode(message)
    return len(data).to_bytes(LENGTH_BYTES, "little") + data


def length_of(head: bytes) -> int:
    """Length of the message behind a head.

    Raises:
        PipeError: longer than any.
    """
    length = int.from_bytes(head, "little")
    if length > LARGEST_BYTES:
        raise PipeError(f"a message of {length} bytes")
    return length
