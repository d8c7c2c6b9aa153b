"""Textual's driver for a browser: the terminal runs on without a client, and redraws for each new one."""

from collections.abc import Callable
from typing import Any, Final

from textual._xterm_parser import XTermParser
from textual.app import App
from textual.constants import ESCAPE_DELAY
from textual.driver import Driver
from textual.events import AppBlur, AppFocus, Resize
from textual.geometry import Size

BEGIN: Final = "\x1b[?1049h\x1b[?25l\x1b[?1000h\x1b[?1003h\x1b[?1006h\x1b[?2004h\x1b[?2026$p"
"""A screen of its own without a cursor; the mouse, pasted text in brackets; can it show changes in one go?"""
FIRST_SIZE: Final = (80, 24)
"""Columns and lines until somebody looks."""


class BrowserDriver(Driver):
    """The end of a websocket, for Textual; see `gloc3_groundstation.web.server.Window`."""

    def __init__(
        self, app: App[Any], *, debug: bool = False, mouse: bool = True, size: tuple[int, int] | None = None
    ) -> None:
        """Made by Textual; `Driver` tells the arguments."""
        super().__init__(app, debug=debug, mouse=mouse, size=size or FIRST_SIZE)
        self._show: Callable[[bytes], None] | None = None
        self._parser = XTermParser()

    @property
    def is_web(self) -> bool:
        """It is."""
        return True

    # --- what a browser does ---

    def attach(self, show: Callable[[bytes], None], columns: int, lines: int) -> None:
        """Shows the terminal to somebody, from its beginning."""
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
        """Draws nothing more; who serves the browser tells it the end."""
        self.detach()

    def _end_of_sequence(self) -> None:
        """An escape that nothing followed is a key of its own."""
        for event in self._parser.tick():
            self.process_message(event)
