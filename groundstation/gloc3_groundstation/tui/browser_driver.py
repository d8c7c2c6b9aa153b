"""Textual's driver for a browser: the terminal continues to run without a client, and redraws for each new one."""

from collections.abc import Callable
from typing import Any, Final

from textual._xterm_parser import XTermParser
from textual.app import App
from textual.constants import ESCAPE_DELAY
from textual.driver import Driver
from textual.events import AppBlur, AppFocus, Resize
from textual.geometry import Size

BEGIN: Final = "\x1b[?1049h\x1b[?25l\x1b[?1000h\x1b[?1003h\x1b[?1006h\x1b[?2004h\x1b[?2026$p"
"""Alternate screen without a cursor; mouse events; bracketed paste; query for synchronized output."""
FIRST_SIZE: Final = (80, 24)
"""Columns and lines before the first client."""


class BrowserDriver(Driver):
    """The end of a websocket, for Textual; see `gloc3_groundstation.web.terminal_view.TerminalWindow`."""

    def __init__(
        self, app: App[Any], *, debug: bool = False, mouse: bool = True, size: tuple[int, int] | None = None
    ) -> None:
        """Called by Textual; see `Driver` for the arguments."""
        super().__init__(app, debug=debug, mouse=mouse, size=size or FIRST_SIZE)
        self._show: Callable[[bytes], None] | None = None
        self._parser = XTermParser()

    @property
    def is_web(self) -> bool:
        """It is."""
        return True

    @property
    def vehicle(self) -> str:
        """Name of the vehicle in view; empty without one."""
        platform = getattr(self._app, "platform", None)
        return "" if platform is None else str(platform.name)

    # --- what a browser does ---

    def attach(self, show: Callable[[bytes], None], columns: int, lines: int) -> None:
        """Shows the whole terminal to a client."""
        self._show = show
        self._parser = XTermParser()
        self.write(BEGIN)
        self.resized(columns, lines)
        self._app.refresh(layout=True)

    def detach(self) -> None:
        """Detaches the client; further output is discarded."""
        self._show = None

    def typed(self, text: str) -> None:
        """Handles a terminal's input sequences for keys and mouse."""
        for event in self._parser.feed(text) if text else ():
            self.process_message(event)
        self._loop.call_later(1.1 * ESCAPE_DELAY, self._end_of_sequence)

    def resized(self, columns: int, lines: int) -> None:
        """Lays out for another size."""
        size = Size(columns, lines)
        self._size = columns, lines
        self.process_message(Resize(size, size))

    def focused(self, is_focused: bool) -> None:
        """Whether keys go to the terminal."""
        self.process_message(AppFocus() if is_focused else AppBlur())

    # --- what Textual does ---

    def write(self, data: str) -> None:
        """Draws."""
        if self._show is not None:
            self._show(data.encode())

    def start_application_mode(self) -> None:
        """Begins with a size, as a terminal does."""
        self.resized(*(self._size or FIRST_SIZE))

    def disable_input(self) -> None:
        """Nothing is read here that could be left unread."""

    def stop_application_mode(self) -> None:
        """Stops drawing; the web server notifies the browser."""
        self.detach()

    def _end_of_sequence(self) -> None:
        """Treats an escape without a following sequence as a key."""
        for event in self._parser.tick():
            self.process_message(event)
