"""The terminal in browsers: who it is shown to, what they are sent, and which of their keys count.

One operator's window holds the terminal at a time; windows without rights mirror it.
"""

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Protocol

import msgspec

from gloc3_groundstation.web.glass import Glass, parts_of

if TYPE_CHECKING:
    from aiohttp import web

NOT_YET_S: Final = 0.05
LARGEST: Final = 1000
"""Columns or lines that a browser may ask for."""
HOLD_KEY: Final = "\x00"
"""Control and space: holds on every screen, while typing too."""
REPLACED: Final = (
    "\x1b[2J\x1b[H\r\n  The station is shown in another window.\r\n\r\n  Press enter to show it here; it is then no "
    "longer shown there.\r\n"
)

Notify = Callable[[str, bool], None]
"""Called with text about a viewer that connects or leaves, and whether there is one now."""


class TerminalWindow(Protocol):
    """The terminal, as a browser sees it."""

    @property
    def vehicle(self) -> str:
        """Name of the vehicle in view; empty without one."""

    def attach(self, show: Callable[[bytes], None], columns: int, lines: int) -> None:
        """Draws the whole terminal, and changes from then on."""

    def detach(self) -> None:
        """Draws nothing more."""

    def typed(self, text: str) -> None:
        """Handles a terminal's input sequences for keys and mouse."""

    def resized(self, columns: int, lines: int) -> None:
        """Lays out for another size."""

    def focused(self, is_focused: bool) -> None:
        """Whether keys go to the terminal."""


class Hello(msgspec.Struct, frozen=True):
    """A page's introduction; what it leaves out, or has wrong, has its usual value."""

    width: object = None
    height: object = None
    window: object = ""
    """The window's name, the same when the page is loaded again."""
    was_shown: object = True
    """Whether it held the terminal before its connection was lost; True for a new one."""


class TerminalView:
    """The terminal, and the browsers that it is shown to."""

    def __init__(self, window: Callable[[], TerminalWindow | None], reported: Notify, station: str) -> None:
        """Creates a view without browsers.

        Args:
            window: returns the terminal; None before it exists.
            reported: called about viewers that connect or leave.
            station: identifies this run of the station; a page that finds another loads itself again.
        """
        self._window = window
        self._reported = reported
        self._station = station
        self._shown: Glass | None = None
        self._mirrors: dict[Glass, None] = {}

    async def serve(self, socket: "web.WebSocketResponse", who: str, *, may_command: bool) -> None:
        """One browser's window, from its opening to its end."""
        glass = Glass(socket, asyncio.get_running_loop().time, who, may_command=may_command)
        glass.notify("hello", {"station": self._station, "may_command": may_command})
        try:
            await glass.converse(lambda data: self.receive(glass, data), lambda: self._draw(glass))
        finally:
            self._leave(glass)

    def close(self) -> None:
        """Shows the terminal to nobody more."""
        self._shown = None
        self._mirrors.clear()

    def receive(self, glass: Glass, data: str) -> None:
        """Handles a message of the page; unknown ones are ignored."""
        kind, *values = parts_of(data)
        is_shown, window = self._shown is glass, self._window()
        match kind, *values:
            case "hello", dict(fields):
                self._introduce(glass, msgspec.convert(fields, Hello))
            case "ping", str(value):
                glass.notify("pong", value)
            case "resize", {"width": int(columns), "height": int(lines)}:
                glass.columns, glass.lines = side(columns, "width"), side(lines, "height")
                if is_shown or (glass in self._mirrors and self._leading is glass):
                    self._resize(glass.columns, glass.lines)
            case ("stdin" | "hold", *_) if not glass.may_command:
                glass.notify("read_only")
            case "stdin", str(text), beat_ms if glass.is_current(beat_ms):
                if is_shown and window is not None:
                    window.typed(text)
                elif "\r" in text and not is_shown:
                    self._replace(glass)
            case "hold", beat_ms if glass.is_current(beat_ms):
                if not is_shown:
                    self._replace(glass)
                if window is not None:
                    glass.notify("hold", window.vehicle)
                    window.typed(HOLD_KEY)
            case ("focus" | "blur",) if is_shown and window is not None:
                window.focused(kind == "focus")

    # --- whose window it is ---

    @property
    def _leading(self) -> Glass | None:
        """The window whose size the terminal has."""
        return self._shown or next(iter(self._mirrors), None)

    def _introduce(self, glass: Glass, hello: Hello) -> None:
        glass.columns, glass.lines = side(hello.width, "width"), side(hello.height, "height")
        glass.window = hello.window if isinstance(hello.window, str) else ""
        if not glass.may_command:
            self._mirrors[glass] = None
            self._reported(f"{glass.who} watches the station, read-only", self._shown is not None)
            self._draw(glass)
            return
        is_free = hello.was_shown is not False if self._shown is None else glass.window == self._shown.window != ""
        if is_free:
            self._replace(glass)
        else:
            self._hide(glass)

    def _replace(self, glass: Glass) -> None:
        other, self._shown = self._shown, glass
        if other is not None:
            self._hide(other)
        glass.notify("shown", True)
        self._reported(f"the station is shown to {glass.who}", True)
        self._draw(glass)

    @staticmethod
    def _hide(glass: Glass) -> None:
        glass.show(REPLACED.encode())
        glass.notify("shown", False)

    def _draw(self, glass: Glass) -> None:
        """Draws all of the terminal; a little later where that is not there yet."""
        window, leading = self._window(), self._leading
        if leading is None or not (glass is self._shown or glass in self._mirrors):
            return
        if window is None:
            asyncio.get_running_loop().call_later(NOT_YET_S, self._draw, glass)
            return
        self._report_size(leading.columns, leading.lines)
        window.attach(self._show, leading.columns, leading.lines)

    def _show(self, data: bytes) -> None:
        if self._shown is not None:
            self._shown.show(data)
        for mirror in self._mirrors:
            mirror.show(data)

    def _resize(self, columns: int, lines: int) -> None:
        window = self._window()
        if window is not None:
            self._report_size(columns, lines)
            window.resized(columns, lines)

    def _report_size(self, columns: int, lines: int) -> None:
        for mirror in self._mirrors:
            mirror.notify("size", *((None, None) if mirror is self._leading else (columns, lines)))

    def _leave(self, glass: Glass) -> None:
        if glass in self._mirrors:
            del self._mirrors[glass]
            self._reported(f"{glass.who} has stopped watching", self._shown is not None)
        elif self._shown is glass:
            self._shown = None
            self._reported(f"{glass.who} has disconnected; the station runs on without an operator's window", False)
        else:
            return
        window, leading = self._window(), self._leading
        if window is not None and leading is None:
            window.detach()
        elif leading is not None:
            self._draw(leading)


def side(value: object, name: str) -> int:
    """Columns or lines as reported by a browser."""
    number = value if isinstance(value, int) else 0
    return min(number, LARGEST) if number > 0 else {"width": 80, "height": 24}[name]
