"""Gamepad on Linux's joystick interface: events of eight bytes from `/dev/input/js0`, or from a FIFO."""

import asyncio
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gloc3.errors import Refused
from gloc3_groundstation.desk.teleoperation import StickDemand

EVENT: Final = struct.Struct("<IhBB")
"""`struct js_event` of linux/joystick.h: milliseconds, value, kind, number."""
_BUTTON: Final = 0x01
_AXIS: Final = 0x02
_INITIAL: Final = 0x80
"""Flag of the initial state reported when the device is opened; it is not an input."""
FULL: Final = 32767
DEAD_ZONE: Final = 0.08
"""Dead zone of a released stick, as a share of its range."""
YAW_AXIS, HEAVE_AXIS, SWAY_AXIS, SURGE_AXIS = 0, 1, 3, 4
"""Axis numbers of the driver `xpad`. The left stick is yaw and heave, the right one surge and sway, as usual for ROVs
(mode 2)."""
DEAD_MAN: Final = (4, 5)
"""The shoulder buttons: either of them."""
READ_BYTES: Final = 64 * EVENT.size


class GamepadState:
    """State of a gamepad from its events; fed bytes, which may be cut anywhere."""

    def __init__(self) -> None:
        self._remainder = b""
        self._axes: dict[int, float] = {}
        self._held: set[int] = set()

    @property
    def is_held(self) -> bool:
        """Whether a dead-man's button is held."""
        return bool(self._held)

    @property
    def sticks(self) -> StickDemand:
        """Where the sticks are; a joystick's axes count to the right and towards the operator."""
        surge, sway = -self._axis(SURGE_AXIS), self._axis(SWAY_AXIS)
        return StickDemand(surge, sway, -self._axis(HEAVE_AXIS), self._axis(YAW_AXIS))

    def feed(self, data: bytes) -> None:
        """Takes bytes in."""
        data = self._remainder + data
        whole = len(data) - len(data) % EVENT.size
        self._remainder = data[whole:]
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            if kind & ~_INITIAL == _AXIS:
                self._axes[number] = max(-1.0, value / FULL)
            elif kind == _BUTTON and number in DEAD_MAN:
                (self._held.add if value else self._held.discard)(number)

    def _axis(self, number: int) -> float:
        """From -1 to 1; starts at 0 at the edge of the dead zone, without a step."""
        value = self._axes.get(number, 0.0)
        beyond = max(0.0, abs(value) - DEAD_ZONE) / (1.0 - DEAD_ZONE)
        return beyond if value > 0.0 else -beyond


class Gamepad:
    """Reads a gamepad in the event loop.

    Args:
        path: of the device; a FIFO, too.
        loop: the event loop.
        moved: called with the state after each batch of events, and with a released state after the device is lost.
    """

    def __init__(self, path: Path, loop: asyncio.AbstractEventLoop, moved: Callable[[GamepadState], None]) -> None:
        """Opens the device.

        Raises:
            Refused: it cannot be opened; with the reason and what to do.
        """
        self.problem = ""
        """Why nothing comes any more; empty while it is open."""
        self._loop, self._moved, self._state = loop, moved, GamepadState()
        self._path = path
        try:
            self._file: int | None = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            hint = "; its user must be in the group input" if isinstance(error, PermissionError) else ""
            raise Refused(f"gamepad {path}: {error.strerror}{hint}") from None
        loop.add_reader(self._file, self._read)

    def close(self) -> None:
        """Reads no more."""
        if self._file is not None:
            self._loop.remove_reader(self._file)
            os.close(self._file)
            self._file = None

    def _read(self) -> None:
        assert self._file is not None
        try:
            data = os.read(self._file, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error.strerror or "it cannot be read")
            return
        if not data:
            self._end("it is disconnected")
            return
        self._state.feed(data)
        self._moved(self._state)

    def _end(self, reason: str) -> None:
        """Handles the loss of the device: all inputs are released."""
        self.problem = f"gamepad {self._path}: {reason}"
        self.close()
        self._state = GamepadState()
        self._moved(self._state)
