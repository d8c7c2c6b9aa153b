"""Joysticks on Linux's joystick interface: events of eight bytes from `/dev/input/js0`, or from a FIFO."""

import asyncio
import fcntl
import os
import struct
from pathlib import Path
from typing import Final

from gloc3_groundstation.joysticks.defaults import linux_controls
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading
from gloc3_groundstation.joysticks.listener import ALIVE_S, JoystickListener

EVENT: Final = struct.Struct("<IhBB")
"""`struct js_event` of linux/joystick.h: milliseconds, value, kind, number."""
_BUTTON: Final = 0x01
_AXIS: Final = 0x02
_INITIAL: Final = 0x80
"""Flag of the initial state reported when the device is opened; a button in it was not pressed by anybody."""
FULL: Final = 32767
READ_BYTES: Final = 512 * EVENT.size
NAME_BYTES: Final = 128
JSIOCGNAME: Final = 0x80006A13 | NAME_BYTES << 16
SEARCH_S: Final = 1.0
"""Time between two searches for joysticks, s."""
FOLDER: Final = Path("/dev/input")


class EventState:
    """Positions of one joystick from its events; fed bytes, which may be cut anywhere."""

    def __init__(self) -> None:
        self._remainder = b""
        self._axes: dict[int, float] = {}
        self._pressed: set[int] = set()

    @property
    def reading(self) -> JoystickReading:
        """The positions now."""
        count = max(self._axes, default=-1) + 1
        return JoystickReading(tuple(self._axes.get(axis, 0.0) for axis in range(count)), frozenset(self._pressed))

    def feed(self, data: bytes) -> None:
        """Takes bytes in."""
        data = self._remainder + data
        whole = len(data) - len(data) % EVENT.size
        self._remainder = data[whole:]
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            if kind & ~_INITIAL == _AXIS:
                self._axes[number] = max(-1.0, value / FULL)
            elif kind == _BUTTON:
                (self._pressed.add if value else self._pressed.discard)(number)


class _Opened:
    __slots__ = ("file", "has_read", "number", "state")

    def __init__(self, file: int, number: int) -> None:
        self.file, self.number, self.state, self.has_read = file, number, EventState(), False


class LinuxReader:
    """Reads joysticks in the event loop; each is opened again when it is plugged in again.

    Args:
        loop: the event loop.
        listener: receives what is found.
        path: of the one device or FIFO to read; None for every `/dev/input/js…`.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, listener: JoystickListener, path: Path | None = None) -> None:
        self._loop, self._listener, self._path = loop, listener, path
        self._opened: dict[Path, _Opened] = {}
        self._count = 0
        self._problem = ""
        self._search_s = loop.time()
        self._timer: asyncio.TimerHandle | None = None
        self._tick()

    async def close(self) -> None:
        """Reads no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for path in tuple(self._opened):
            self._drop(path)

    def _tick(self) -> None:
        """Searches for devices, and repeats the positions of those that are open: the kernel reports changes only."""
        if self._loop.time() >= self._search_s:
            self._search_s = self._loop.time() + SEARCH_S
            self._search()
        for opened in (one for one in self._opened.values() if one.has_read):
            self._listener.moved(opened.number, opened.state.reading)
        self._timer = self._loop.call_later(ALIVE_S, self._tick)

    def _search(self) -> None:
        paths = sorted(FOLDER.glob("js*")) if self._path is None else [self._path]
        problem = "" if paths else "no joystick is found"
        for path in paths:
            if path not in self._opened:
                problem = self._open(path) or problem
        if problem != self._problem:
            self._problem = problem
            if problem:
                self._listener.failed(problem)

    def _open(self, path: Path) -> str:
        """Opens a device; returns why it cannot."""
        try:
            file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            hint = "; its user must be in the group input" if isinstance(error, PermissionError) else ""
            return f"joystick {path}: {error.strerror}{hint}"
        self._count += 1
        self._opened[path] = _Opened(file, self._count)
        name = _name_of(file)
        device = JoystickDevice(key=name or path.name, name=name or str(path), controls=linux_controls(name))
        self._listener.connected(self._count, device)
        self._loop.add_reader(file, self._read, path)
        return ""

    def _read(self, path: Path) -> None:
        opened = self._opened[path]
        try:
            data = os.read(opened.file, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(path, error.strerror or "it cannot be read")
            return
        if not data:
            self._lose(path, "it is disconnected")
            return
        opened.state.feed(data)
        opened.has_read = True
        self._listener.moved(opened.number, opened.state.reading)

    def _lose(self, path: Path, reason: str) -> None:
        number = self._opened[path].number
        self._drop(path)
        self._listener.disconnected(number, reason)

    def _drop(self, path: Path) -> None:
        file = self._opened.pop(path).file
        self._loop.remove_reader(file)
        os.close(file)


def _name_of(file: int) -> str:
    """The kernel's name of a joystick; empty of a FIFO."""
    name = bytearray(NAME_BYTES)
    try:
        fcntl.ioctl(file, JSIOCGNAME, name)
    except OSError:
        return ""
    return name.split(b"\0", 1)[0].decode("utf-8", "replace")
