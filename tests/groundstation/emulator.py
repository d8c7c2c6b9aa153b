"""A terminal's screen, read from the bytes that a program sends to it."""

import re

import pyte

UNKNOWN = re.compile(rb"\x1b\[\?\d+\$p|\x1b\[[<>=][\d;]*[a-zA-Z]|\x1b\[\?u")
"""What pyte would show as text: questions on modes, and the keyboard's protocol."""
BEGUN = re.compile(rb"\x1b(\[[?<>=]?[\d;]*\$?)?$")
"""A sequence of which the end has not come yet."""


class Emulator:
    """What a program shows."""

    def __init__(self, columns: int, lines: int) -> None:
        self._screen = pyte.Screen(columns, lines)
        self._stream = pyte.ByteStream(self._screen)
        self._begun = b""
        self.received = 0
        """Bytes that have come."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines."""
        return self._screen.columns, self._screen.lines

    def feed(self, data: bytes) -> None:
        """Takes what the program sends."""
        self.received += len(data)
        data = self._begun + data
        begun = BEGUN.search(data)
        self._begun = data[begun.start() :] if begun else b""
        self._stream.feed(UNKNOWN.sub(b"", data[: begun.start()] if begun else data))

    def resize(self, columns: int, lines: int) -> None:
        """Has another size; what does not fit is lost."""
        self._screen.resize(lines, columns)

    def lines(self) -> list[str]:
        """What each line shows."""
        return [line.rstrip() for line in self._screen.display]

    def text(self) -> str:
        """What is shown."""
        return "\n".join(self.lines())

    def place(self, text: str) -> tuple[int, int]:
        """Column and line where a text begins, from 0."""
        for number, line in enumerate(self._screen.display):
            if text in line:
                return line.index(text), number
        raise AssertionError(f"{text!r} is not shown:\n{self.text()}")
