"""A grid of characters with tones, in which wires join where they meet."""

from itertools import pairwise
from typing import Final

from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone

NORTH, EAST, SOUTH, WEST = 1, 2, 4, 8
WIRES: Final = {
    NORTH | SOUTH: "│",
    NORTH: "│",
    SOUTH: "│",
    EAST | WEST: "─",
    EAST: "─",
    WEST: "─",
    SOUTH | EAST: "╭",
    SOUTH | WEST: "╮",
    NORTH | EAST: "╰",
    NORTH | WEST: "╯",
    NORTH | SOUTH | EAST: "├",
    NORTH | SOUTH | WEST: "┤",
    EAST | WEST | SOUTH: "┬",
    EAST | WEST | NORTH: "┴",
    NORTH | EAST | SOUTH | WEST: "┼",
}
"""The directions in which a wire leaves a cell, to the character."""


class GraphCanvas:
    """A grid of characters that grows to fit its contents."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], tuple[str, Tone]] = {}
        self._wires: dict[tuple[int, int], int] = {}
        self.width = 0
        self.height = 0

    def text(self, x: int, y: int, text: str, tone: Tone = Tone.TEXT) -> None:
        """Writes text over existing characters."""
        for offset, letter in enumerate(text):
            self._cells[y, x + offset] = letter, tone
        self._reach(x + len(text), y + 1)

    def wire(self, *points: tuple[int, int]) -> None:
        """Draws a line through points `(x, y)`, straight between them; it joins other wires that it meets."""
        for (x0, y0), (x1, y1) in pairwise(points):
            dx, dy = (x1 > x0) - (x1 < x0), (y1 > y0) - (y1 < y0)
            ahead = EAST if dx > 0 else WEST if dx < 0 else SOUTH if dy > 0 else NORTH
            back = WEST if dx > 0 else EAST if dx < 0 else NORTH if dy > 0 else SOUTH
            x, y = x0, y0
            while (x, y) != (x1, y1):
                self._wires[y, x] = self._wires.get((y, x), 0) | ahead
                x, y = x + dx, y + dy
                self._wires[y, x] = self._wires.get((y, x), 0) | back
            self._reach(max(x0, x1) + 1, max(y0, y1) + 1)

    def box(self, x: int, y: int, width: int, height: int, tone: Tone) -> None:
        """A frame with round corners."""
        self.text(x, y, "╭" + "─" * (width - 2) + "╮", tone)
        for row in range(y + 1, y + height - 1):
            self.text(x, row, "│", tone)
            self.text(x + width - 1, row, "│", tone)
        self.text(x, y + height - 1, "╰" + "─" * (width - 2) + "╯", tone)

    def lines(self, tone: Tone = Tone.DIM) -> list[Line]:
        """What was drawn; `tone` is that of the wires."""
        return [self._line(y, tone) for y in range(self.height)]

    def _line(self, y: int, tone: Tone) -> Line:
        spans: list[Span] = []
        run, of = "", Tone.TEXT
        for x in range(self.width):
            wire = self._wires.get((y, x))
            letter, now = self._cells.get((y, x)) or ((WIRES[wire], tone) if wire else (" ", of))
            if now is not of and run:
                spans.append(Span(run, of))
                run = ""
            run, of = run + letter, now
        return (*spans, Span(run, of)) if run.strip() else tuple(spans)

    def _reach(self, width: int, height: int) -> None:
        self.width, self.height = max(self.width, width), max(self.height, height)
