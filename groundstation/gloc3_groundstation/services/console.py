"""The vehicle's console: lines typed into PX4's shell, and its output as text that steers no terminal."""

import re
from codecs import getincrementaldecoder
from collections import deque
from collections.abc import Sequence
from typing import Any, Final

from gloc3.documents.characters import HARMLESS, first_steering, steers
from gloc3.errors import Refused
from gloc3.mavlink.shell import ShellClient, ShellData
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.snapshot import Firmware, SnapshotService

ANSWER_S: Final = 2.0
"""Longest time for the first output of the shell, and after a line for its next."""
ATTEMPTS: Final = 3
LONGEST_LINE: Final = 200
MOST_LINES: Final = 2000
"""Lines of output that are kept."""
WIDEST: Final = 500
"""Characters of a line of output; longer ones are broken."""
PROMPT: Final = "nsh> "
INTERRUPT: Final = b"\x03"
_TAB: Final = 8
_PIECE: Final = re.compile(
    r"\x1b\[[0-9;?]*(?P<csi>[@-~])|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|\x1b[()][0-9A-Za-z]|\x1b[=>78]|(?P<letter>.)",
    re.DOTALL,
)
_BEGUN: Final = re.compile(r"\x1b(?:\[[0-9;?]{0,20}|\][^\x07\x1b]{0,200}\x1b?|[()])?\Z")
"""A control sequence whose end has not come."""


class ConsoleText:
    """Output of a shell as lines.

    Carriage return, backspace, tab and "erase to the end of the line" are carried out, other sequences are left out, and
    every other character that steers a terminal is replaced.
    """

    def __init__(self) -> None:
        self.first = 0
        """Number of the oldest line that is kept."""
        self._lines: deque[str] = deque()
        self._current: list[str] = []
        self._column = 0
        self._rest = ""
        self._decoder = getincrementaldecoder("utf-8")(errors="replace")

    @property
    def current(self) -> str:
        """The line that is not ended, as the prompt."""
        return "".join(self._current)

    @property
    def lines(self) -> Sequence[str]:
        """All lines, the unfinished one last."""
        return (*self._lines, self.current)

    def feed(self, data: bytes) -> None:
        """Adds output."""
        text = self._rest + self._decoder.decode(data)
        begun = _BEGUN.search(text)
        self._rest = "" if begun is None else begun[0]
        for piece in _PIECE.finditer(text, 0, len(text) - len(self._rest)):
            if piece["letter"] is not None:
                self._put(piece["letter"])
            elif piece["csi"] == "K":
                del self._current[self._column :]

    def _put(self, letter: str) -> None:
        if letter == "\n" or len(self._current) >= WIDEST:
            self._end_line()
        match letter:
            case "\n":
                pass
            case "\r":
                self._column = 0
            case "\b":
                self._column = max(0, self._column - 1)
            case "\t":
                for _ in range(_TAB - self._column % _TAB):
                    self._type(" ")
            case _:
                self._type(HARMLESS if steers(letter) else letter)

    def _type(self, letter: str) -> None:
        self._current[self._column : self._column + 1] = letter
        self._column += 1

    def _end_line(self) -> None:
        self._lines.append(self.current)
        self._current, self._column = [], 0
        if len(self._lines) > MOST_LINES:
            self._lines.popleft()
            self.first += 1


class ConsoleService:
    """Types into the shell of one vehicle.

    Args:
        machines: run the client.
        client: speaks the protocol.
        snapshot: of the vehicle.
    """

    def __init__(self, machines: Machines, client: ShellClient, snapshot: SnapshotService) -> None:
        self.text: Final = ConsoleText()
        self.is_open = False
        """Whether the shell has answered, and was not left."""
        self._machines, self._client, self._snapshot = machines, client, snapshot
        self._received = 0
        """Pieces of output so far."""
        machines.on_event(self._on_event)

    async def open(self, *, while_armed: bool = False) -> None:
        """Waits for the shell to answer.

        Args:
            while_armed: also while the vehicle is armed.

        Raises:
            Refused: the vehicle has no shell or does not answer, or it is armed.
        """
        if self.is_open:
            return
        await self._check(while_armed)
        for _ in range(ATTEMPTS):
            if await self._write(b"\n"):
                self.is_open = True
                return
        raise Refused(
            f"the vehicle does not answer on its shell ({ATTEMPTS} attempts of {ANSWER_S:g} s): its firmware has none in "
            "MAVLink, or something on the way drops SERIAL_CONTROL"
        )

    async def run(self, line: str, *, while_armed: bool = False) -> None:
        """Types a line, and waits until the prompt is back or the output pauses.

        Args:
            line: without its end.
            while_armed: also while the vehicle is armed.

        Raises:
            Refused: the line has control characters or is too long, the vehicle is armed, or nothing came back.
        """
        if first_steering(line) or len(line.encode()) > LONGEST_LINE:
            raise Refused(f"a line of the shell has at most {LONGEST_LINE} bytes, and no control characters")
        await self.open(while_armed=while_armed)
        await self._check(while_armed)
        if not await self._write(line.encode() + b"\n"):
            self.is_open = False
            raise Refused(f"nothing came back for {ANSWER_S:g} s; the line may be lost: look before you type it again")

    def interrupt(self) -> None:
        """Types Ctrl-C."""
        self._client.write(INTERRUPT)
        self._machines.settle()

    def leave(self) -> None:
        """Ends the shell on the vehicle."""
        if self.is_open:
            self.is_open = False
            self._client.leave()
            self._machines.settle()

    async def _check(self, while_armed: bool) -> None:
        snapshot = await self._snapshot.learn(self._machines)
        if snapshot.firmware is Firmware.ARDUPILOT:
            raise Refused("ArduPilot has no shell in MAVLink; the console is for PX4")
        if snapshot.is_armed and not while_armed:
            raise Refused("the vehicle is armed; nothing was typed into its shell")

    async def _write(self, data: bytes) -> bool:
        """Types, and waits for the prompt or a pause; returns whether any output came."""
        self._client.write(data)
        has_answered = False
        while await self._next_output():
            has_answered = True
            if self.text.current == PROMPT:
                break
        return has_answered

    async def _next_output(self) -> bool:
        """Waits for more output; false after a pause."""
        machines, before = self._machines, self._received
        ends_s = machines.now_s + ANSWER_S
        timer = machines.loop.call_at(ends_s, machines.settle)
        try:
            await machines.until(lambda: self._received > before or machines.now_s >= ends_s)
        finally:
            timer.cancel()
        return self._received > before

    def _on_event(self, event: Any) -> None:
        if isinstance(event, ShellData):
            self._received += 1
            self.text.feed(event.data)
