"""A raster of braille dots with text: draws clipped lines, areas and ellipses, and returns lines of spans.

A cell of the terminal holds 2 × 4 dots and one tone, that of the last drawing in it. Coordinates are dots from the
upper left corner, x to the right, y down; a dot is about as wide as it is high. NaN splits a line.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone

Dots = NDArray[np.float64]
"""Rows of x and y in dots."""

CELL: Final = (2, 4)
"""Dots of a cell: across and down."""
BRAILLE: Final = 0x2800
SMALL: Final = 1e-6
"""Of a dot: no difference."""
_BITS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)
"""The bit of each dot in a braille character (Unicode 15, 21.1)."""
_TONES: Final = tuple(Tone)
_NUMBERS: Final = {tone: number for number, tone in enumerate(_TONES)}
_EMPTY: Final = 255
_FILLED: Final = tuple(_NUMBERS[tone] for tone in (Tone.CHOSEN, Tone.ALARM))
"""These would be seen where nothing is drawn, too."""


class CellCanvas:
    """So many cells, empty at first."""

    def __init__(self, width: int, height: int) -> None:
        """A canvas.

        Args:
            width: columns.
            height: lines.
        """
        self.width: Final = width
        self.height: Final = height
        self._bits = np.zeros((height, width), np.uint8)
        self._tones = np.zeros((height, width), np.uint8)
        self._texts: list[dict[int, Span]] = [{} for _ in range(height)]

    @property
    def size(self) -> tuple[int, int]:
        """Dots across and down."""
        return self.width * CELL[0], self.height * CELL[1]

    def line(self, points: Dots | Sequence[tuple[float, float]], tone: Tone, *, on: int = 1, off: int = 0) -> None:
        """Joins points.

        Args:
            points: the corners of the line.
            tone: of the line.
            on: dots drawn, alternating with
            off: dots left out.
        """
        corners = np.asarray(points, np.float64).reshape(-1, 2)
        if len(corners) == 1:
            self.points(corners, tone)
        if len(corners) < 2:
            return
        starts, ends = corners[:-1], corners[1:]
        lengths = np.abs(ends - starts).max(axis=1)
        reached = np.cumsum(np.nan_to_num(lengths)) - np.nan_to_num(lengths)
        kept, low, high = _clip(starts, ends, self.size)
        if not len(kept):
            return
        starts, steps, lengths, reached = starts[kept], (ends - starts)[kept], lengths[kept], reached[kept]
        first = np.floor(lengths * low).astype(np.int64)
        counts = np.ceil(lengths * high).astype(np.int64) - first + 1
        which = np.repeat(np.arange(len(kept)), counts)
        number = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts - first, counts)
        share = np.minimum(1.0, number / np.maximum(1e-9, lengths[which]))
        dots = starts[which] + steps[which] * share[:, None] + SMALL
        if off:
            dots = dots[(reached[which] + number) % (on + off) < on]
        self.points(dots, tone)

    def points(self, points: Dots, tone: Tone) -> None:
        """Draws single dots."""
        dots = np.asarray(points, np.float64).reshape(-1, 2)
        width, height = self.size
        with np.errstate(invalid="ignore"):
            is_inside = (dots[:, 0] >= 0) & (dots[:, 0] < width) & (dots[:, 1] >= 0) & (dots[:, 1] < height)
        x, y = dots[is_inside].astype(np.int64).T
        row, column = y // CELL[1], x // CELL[0]
        np.bitwise_or.at(self._bits, (row, column), _BITS[y % CELL[1], x % CELL[0]])
        self._tones[row, column] = _NUMBERS[tone]

    def area(self, corners: Dots | Sequence[tuple[float, float]], tone: Tone, *, hatch: int = 1) -> None:
        """Fills a polygon by the even-odd rule; with `hatch` n only every n-th diagonal of dots is drawn."""
        polygon = np.asarray(corners, np.float64).reshape(-1, 2)
        width, height = self.size
        if len(polygon) < 3 or np.isnan(polygon).any():
            return
        left, top = np.clip(np.floor(polygon.min(axis=0)), 0, (width, height)).astype(int)
        right, bottom = np.clip(np.ceil(polygon.max(axis=0)) + 1, 0, (width, height)).astype(int)
        if right <= left or bottom <= top:
            return
        x, y = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
        is_inside = np.zeros(x.shape, bool)
        x0, y0 = polygon[-1]
        for x1, y1 in polygon:
            if y0 != y1:
                is_crossed = ((y0 > y) != (y1 > y)) & (x < x0 + (x1 - x0) * (y - y0) / (y1 - y0))
                is_inside ^= is_crossed
            x0, y0 = x1, y1
        if hatch > 1:
            is_inside &= (x + y).astype(int) % hatch == 0
        self.points(np.column_stack((x[is_inside], y[is_inside])), tone)

    def text(self, column: int, row: int, text: str, tone: Tone) -> None:
        """Writes text in cells, over existing drawings; text outside the canvas is cut off."""
        if 0 <= row < self.height:
            cells = self._texts[row]
            for index, letter in enumerate(text, start=column):
                if 0 <= index < self.width:
                    cells[index] = Span(letter, tone)

    def is_free(self, column: int, row: int, length: int) -> bool:
        """Whether there is room on the canvas for `length` characters, without other text."""
        if not 0 <= row < self.height or column < 0 or column + length > self.width:
            return False
        cells = self._texts[row]
        return not any(index in cells for index in range(column, column + length))

    def lines(self) -> list[Line]:
        """What was drawn, a line for each row of cells."""
        return [self._line(row) for row in range(self.height)]

    def _line(self, row: int) -> Line:
        bits, texts = self._bits[row], self._texts[row]
        if not texts and not bits.any():
            return (Span(" " * self.width),)
        letters = [chr(BRAILLE + bit) if bit else " " for bit in bits.tolist()]
        numbers = np.where(bits, self._tones[row], _EMPTY).tolist()
        for column, span in texts.items():
            letters[column], numbers[column] = span.text, _NUMBERS[span.tone]
        spans: list[Span] = []
        begin, tone = 0, _EMPTY
        for column, number in enumerate(numbers):
            if number == tone or (number == _EMPTY and tone not in _FILLED):
                continue  # what is empty has no tone of its own
            if tone != _EMPTY or (number in _FILLED and column > begin):
                spans.append(Span("".join(letters[begin:column]), _TONES[tone] if tone != _EMPTY else Tone.TEXT))
                begin = column
            tone = number
        spans.append(Span("".join(letters[begin:]), _TONES[tone] if tone != _EMPTY else Tone.TEXT))
        return tuple(spans)


def _clip(
    starts: Dots, ends: Dots, size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The pieces that reach the canvas, and the shares of each between which they do (Liang and Barsky, 1984)."""
    low, high = np.zeros(len(starts)), np.ones(len(starts))
    is_kept = ~(np.isnan(starts).any(axis=1) | np.isnan(ends).any(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in (0, 1):
            start, step = starts[:, axis], ends[:, axis] - starts[:, axis]
            step = np.where(np.abs(step) < SMALL, 0.0, step)
            near, far = -start / step, (size[axis] - start) / step
            is_flat = step == 0.0
            is_kept &= ~is_flat | ((start >= 0.0) & (start < size[axis]))
            low = np.where(is_flat, low, np.maximum(low, np.minimum(near, far)))
            high = np.where(is_flat, high, np.minimum(high, np.maximum(near, far)))
        is_kept &= low <= high
    kept = np.flatnonzero(is_kept)
    return kept, low[kept], high[kept]
