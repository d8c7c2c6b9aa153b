"""The shell of a vehicle in SERIAL_CONTROL: the station's end, and the vehicle's.

PX4 gives its system console so (device `SERIAL_CONTROL_DEV_SHELL`): what is typed goes there in pieces of 70 bytes, and
output comes back as it is made. Nothing is acknowledged or repeated.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice

SHELL: Final = 10
"""SERIAL_CONTROL_DEV_SHELL."""
PIECE_BYTES: Final = 70
_REPLY, _RESPOND, _EXCLUSIVE = 1, 2, 4
"""SERIAL_CONTROL_FLAG."""


class ShellData(NamedTuple):
    """Bytes of the other end: output for the station, typed bytes for the vehicle."""

    sender: Address
    data: bytes


class _ShellEnd(Microservice[ShellData]):
    """What both ends have in common."""

    handles = frozenset({"SERIAL_CONTROL"})
    _own_flags: int
    _is_reply: bool
    """Whether the other end's messages are replies."""

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Keeps the bytes of the shell that are for this end."""
        is_ours = message.device == SHELL and bool(message.flags & _REPLY) is self._is_reply
        data = bytes(message.data[: message.count])
        if is_ours and data and self._is_for_us(message):
            self._events.append(ShellData(sender, data))

    def _send_data(self, target: Address, data: bytes) -> None:
        for begin in range(0, len(data), PIECE_BYTES):
            self._send_piece(target, data[begin : begin + PIECE_BYTES], self._own_flags)

    def _send_piece(self, target: Address, piece: bytes, flags: int) -> None:
        self._send_to(
            target,
            "SERIAL_CONTROL",
            device=SHELL,
            flags=flags,
            timeout=0,
            baudrate=0,
            count=len(piece),
            data=tuple(piece.ljust(PIECE_BYTES, b"\0")),
        )


class ShellClient(_ShellEnd):
    """The station's end: an event for each piece of output.

    Args:
        own: this station.
        target: whose shell it is.
    """

    _own_flags = _RESPOND | _EXCLUSIVE
    _is_reply = True

    def __init__(self, own: Address, target: Address) -> None:
        super().__init__(own)
        self._target = target

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Keeps output of the target."""
        if sender == self._target:
            super().receive(message, sender, now_s)

    def write(self, data: bytes) -> None:
        """Sends what is typed."""
        self._send_data(self._target, data)

    def leave(self) -> None:
        """Tells the vehicle that no more output is wanted; PX4 ends the shell."""
        self._send_piece(self._target, b"", 0)


class ShellServer(_ShellEnd):
    """The vehicle's end: an event for each piece of what a station has typed."""

    _own_flags = _REPLY
    _is_reply = False

    def reply(self, target: Address, data: bytes) -> None:
        """Sends output."""
        self._send_data(target, data)
