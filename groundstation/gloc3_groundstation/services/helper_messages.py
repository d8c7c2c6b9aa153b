"""Messages between the station and its MAVSDK process over a pipe: length, then msgpack."""

from typing import Final, TypeAlias

import msgspec

from gloc3.errors import Gloc3Error
from gloc3.mavlink.services.plan import PlanItem

LENGTH_BYTES: Final = 4
LARGEST_BYTES: Final = 32_000_000


class LinkReceived(msgspec.Struct, frozen=True, tag=True):
    """To the helper: frames of the vehicle."""

    data: bytes


class UploadPlan(msgspec.Struct, frozen=True, tag=True):
    """To the helper: give the vehicle a plan."""

    number: int
    kind: int
    items: tuple[PlanItem, ...]


class DownloadPlan(msgspec.Struct, frozen=True, tag=True):
    """To the helper: get the vehicle's plan."""

    number: int
    kind: int


class LinkSent(msgspec.Struct, frozen=True, tag=True):
    """From the helper: frames that MAVSDK sends."""

    data: bytes


class Ready(msgspec.Struct, frozen=True, tag=True):
    """From the helper: MAVSDK runs and takes frames."""


class Advanced(msgspec.Struct, frozen=True, tag=True):
    """From the helper: how far a request is, 0 to 1."""

    number: int
    fraction: float


class Done(msgspec.Struct, frozen=True, tag=True):
    """From the helper: a request went well."""

    number: int
    items: tuple[PlanItem, ...] = ()


class Failed(msgspec.Struct, frozen=True, tag=True):
    """From the helper: a request went wrong."""

    number: int
    reason: str


ToHelper: TypeAlias = LinkReceived | UploadPlan | DownloadPlan
FromHelper: TypeAlias = LinkSent | Ready | Advanced | Done | Failed

_encode = msgspec.msgpack.Encoder().encode
to_helper: Final = msgspec.msgpack.Decoder(ToHelper)
from_helper: Final = msgspec.msgpack.Decoder(FromHelper)


class PipeError(Gloc3Error):
    """The other end of the pipe does not speak as agreed."""


def packed(message: ToHelper | FromHelper) -> bytes:
    """A message with its length before it."""
    data = _encode(message)
    return len(data).to_bytes(LENGTH_BYTES, "little") + data


def length_of(head: bytes) -> int:
    """How long the message behind a head is.

    Raises:
        PipeError: longer than any.
    """
    length = int.from_bytes(head, "little")
    if length > LARGEST_BYTES:
        raise PipeError(f"a message of {length} bytes")
    return length
