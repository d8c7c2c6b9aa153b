"""Drawing with braille dots, two across and four down in each character."""

from typing import Final

_BITS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
EMPTY: Final = 0x2800


class Dots:
    """A field of dots, (0, 0) at the top left."""

    def __init__(self, columns: int, rows: int) -> None:
        self.width: Final = 2 * columns
        self.height: Final = 4 * rows
        self._cells = [[0] * columns for _ in range(rows)]

    def dot(self, x: int, y: int) -> None:
        """Sets a dot; one outside is left out."""
        if 0 <= x < self.width and 0 <= y < self.height:
            self._cells[y >> 2][x >> 1] |= _BITS[y & 3][x & 1]

    def line(self, x: int, y: int, to_x: int, to_y: int) -> None:
        """Joins two dots."""
        steps = max(abs(to_x - x), abs(to_y - y), 1)
        for step in range(steps + 1):
            self.dot(round(x + (to_x - x) * step / steps), round(y + (to_y - y) * step / steps))

    def rows(self) -> list[str]:
        """The characters; a cell without a dot is braille too, since in some fonts a blank is narrower."""
        return ["".join(chr(EMPTY + cell) for cell in row) for row in self._cells]
