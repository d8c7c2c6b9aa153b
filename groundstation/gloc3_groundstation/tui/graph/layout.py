"""Places boxes in layers from left to right and draws them with the wires between them."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gloc3_groundstation.tui.graph.canvas import GraphCanvas
from gloc3_groundstation.tui.graph.order import Before, layered, reduced
from gloc3_groundstation.tui.widgets.lines import Tone

GAP: Final = 3
"""Columns between two layers, at least."""
PORT: Final = 1
"""The line of a box at which wires leave and arrive, below its top."""

Heights = Mapping[str, int]


class BoxPosition(NamedTuple):
    """Position of a box."""

    x: int
    y: int
    layer: int


def channel_tracks(wires: list[tuple[int, int]]) -> dict[int, int]:
    """The track of each wire that goes up or down between two layers, by the line where it comes from.

    Args:
        wires: the lines where each comes from and goes to.
    """
    spans: dict[int, tuple[int, int]] = {}
    for start, end in wires:
        low, high = spans.get(start, (start, start))
        spans[start] = min(low, end), max(high, end)
    tracks: list[list[tuple[int, int]]] = []
    found: dict[int, int] = {}
    for start, (low, high) in sorted(spans.items(), key=lambda item: item[1]):
        if low == high:
            continue
        free = (n for n, used in enumerate(tracks) if all(high < other[0] or low > other[1] for other in used))
        track = next(free, len(tracks))
        if track == len(tracks):
            tracks.append([])
        tracks[track].append((low, high))
        found[start] = track
    return found


class Layout:
    """Positions of boxes of known heights and of one width, and of their wires."""

    def __init__(self, before: Before, heights: Heights) -> None:
        """Lays out.

        Args:
            before: the order of the boxes.
            heights: lines of each, frame included.
        """
        self.before: Final = reduced(before)
        self._heights = heights
        self.layers, self._lines = layered(self.before)
        self._came_from: dict[str, list[str]] = {}
        for one, name in self._lines:
            self._came_from.setdefault(name, []).append(one)
        self._tops: dict[str, int] = {}
        for layer in self.layers:
            self._stack(layer)
        self._tracks = [channel_tracks(self._wires(index)) for index in range(len(self.layers) - 1)]
        self.gaps: Final = [max(GAP, 2 + max(tracks.values(), default=-1) + 1) for tracks in self._tracks]

    def widest(self, room: int) -> int:
        """The width that boxes may have so that all of it fits `room` columns."""
        return (room - sum(self.gaps)) // max(1, len(self.layers))

    def places(self, width: int, x: int, y: int) -> dict[str, BoxPosition]:
        """The upper left corner of each box, the first layer at `x`, everything below `y`."""
        found, left = {}, x
        for index, layer in enumerate(self.layers):
            for name in layer:
                if name in self._heights:
                    found[name] = BoxPosition(left, y + self._tops[name], index)
            left += width + (self.gaps[index] if index < len(self.gaps) else 0)
        return found

    def draw_wires(self, canvas: GraphCanvas, width: int, x: int, y: int, tone_of: Callable[[str], Tone]) -> None:
        """Draws the wires, to be called after the boxes were drawn.

        Args:
            canvas: where.
            width: of the boxes.
            x: of the first layer.
            y: of the top.
            tone_of: the tone of a box's frame.
        """
        left = x
        for index, gap in enumerate(self.gaps):
            right = left + width + gap
            for one, name in self._lines:
                if one not in self.layers[index]:
                    continue
                start, end = self._port(one), self._port(name)
                track = left + width + 1 + self._tracks[index].get(start, 0) if start != end else right - 1
                canvas.wire((left + width, y + start), (track, y + start), (track, y + end), (right - 1, y + end))
                if one in self._heights:
                    canvas.text(left + width - 1, y + start, "├", tone_of(one))
                else:
                    canvas.wire((left, y + start), (left + width, y + start))
                if name in self._heights:
                    canvas.text(right - 1, y + end, "▶", Tone.DIM)
            left = right

    def _stack(self, layer: list[str]) -> None:
        """Places a layer's boxes one under the other, each no higher than the first of what leads to it."""
        bottom = 0
        for name in layer:
            wanted = min((self._tops[one] for one in self._came_from.get(name, ())), default=0)
            self._tops[name] = max(bottom, wanted)
            bottom = self._tops[name] + self._heights.get(name, PORT + 1)

    def _wires(self, index: int) -> list[tuple[int, int]]:
        return [(self._port(one), self._port(name)) for one, name in self._lines if one in self.layers[index]]

    def _port(self, name: str) -> int:
        return self._tops[name] + PORT
