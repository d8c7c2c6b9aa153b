"""Panel for a graph: it scrolls in both directions, and a cursor moves from item to item."""

from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.geometry import Region, Size
from textual.message import Message
from textual.strip import Strip

from gloc3.documents.characters import printable
from gloc3_groundstation.tui.views.mission.graph import Graph, GraphSpot
from gloc3_groundstation.tui.widgets.lines import Line
from gloc3_groundstation.tui.widgets.panel import Panel


class GraphPanel(Panel):
    """Shows a graph; `Moved` is posted when the cursor has come to another item. The first line never scrolls sideways."""

    COMPONENT_CLASSES = {"list--cursor"}
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "up", "step(-1)", "Choose", show=False, key_display="↑ ↓ ← →", tooltip="the mission, a task or an action"
        ),
        Binding("down", "step(1)", "Down", show=False),
        Binding("left", "across(-1)", "Left", show=False),
        Binding("right", "across(1)", "Right", show=False),
        Binding("home", "first", "The mission", show=False, key_display="home", tooltip="back to the whole mission"),
    ]

    class Moved(Message):
        """The cursor has moved to another item."""

        def __init__(self, target: str) -> None:
            super().__init__()
            self.target = target

    def __init__(self, *, id: str, classes: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id, classes=classes)
        self._graph = Graph([], (), 0)
        self._target = ""

    @property
    def chosen(self) -> str:
        """The item under the cursor; empty for the mission as a whole."""
        return self._target

    def show_graph(self, graph: Graph, title: str | None = None) -> None:
        """Shows another graph; the cursor stays with its item, or goes to the mission."""
        is_wider = graph.width != self._graph.width
        self._graph = graph
        self.show(graph.lines, title)
        if is_wider or self.virtual_size.height != len(graph.lines):
            self.virtual_size = Size(graph.width, len(graph.lines))
            self.refresh()
        if graph.spot(self._target) is None:
            self._point("")

    def show_lines(self, lines: list[Line]) -> None:
        """Shows text where there is no graph."""
        self.show_graph(Graph(lines, (), 0))

    def action_step(self, step: int) -> None:
        """Goes up or down in a layer; above all layers is the mission."""
        here = self._spot()
        if here is None:
            return
        if not here.target:
            below = [spot for spot in self._graph.spots if spot.layer == 0]
            if step > 0 and below:
                self._point(below[0].target)
            return
        column = [spot for spot in self._graph.spots if spot.layer == here.layer]
        column.sort(key=lambda spot: spot.y)
        index = column.index(here) + step
        self._point(column[min(index, len(column) - 1)].target if index >= 0 else "")

    def action_across(self, step: int) -> None:
        """Goes to the item beside, in the next layer."""
        here = self._spot()
        if here is None:
            return
        layer = max(0, here.layer + step) if here.target else 0
        column = [spot for spot in self._graph.spots if spot.layer == layer and spot.target]
        if column and (here.target or step > 0):
            is_task = "." not in here.target
            alike = [spot for spot in column if ("." not in spot.target) is is_task] or column
            self._point(min(alike, key=lambda spot: abs(spot.y - here.y)).target)

    def action_first(self) -> None:
        """Goes to the mission as a whole."""
        self._point("")

    def render_line(self, y: int) -> Strip:
        """One line of the screen, with the cursor."""
        index, left = y + self.scroll_offset.y, self.scroll_offset.x if y + self.scroll_offset.y else 0
        base = self.rich_style
        if index >= len(self._graph.lines):
            return Strip.blank(self.size.width, base)
        segments = [Segment(printable(span.text), base + self._style(span.tone)) for span in self._graph.lines[index]]
        strip = Strip(segments).adjust_cell_length(max(self._graph.width, self.size.width), base)
        spot = self._spot()
        if spot is not None and spot.y == index:
            strip = self._marked(strip, spot)
        return strip.crop(left, left + self.size.width)

    def _marked(self, strip: Strip, spot: GraphSpot) -> Strip:
        cursor = self.get_component_rich_style("list--cursor", partial=True)
        mark = Style(bgcolor=cursor.bgcolor, reverse=cursor.reverse)
        start, end = spot.x, spot.x + spot.width
        parts = (
            list(strip.divide([start, end, strip.cell_length]))
            if start
            else [Strip([]), *strip.divide([end, strip.cell_length])]
        )
        middle = Strip(
            [Segment(text, (style or Style.null()) + mark) for text, style, _ in parts[1]], parts[1].cell_length
        )
        return Strip.join([parts[0], middle, *parts[2:]])

    def _spot(self) -> GraphSpot | None:
        return self._graph.spot(self._target)

    def _point(self, target: str) -> None:
        if target != self._target:
            self._target = target
            self.post_message(self.Moved(target))
            self.refresh()
        spot = self._spot()
        if spot is not None:
            region = Region(spot.x, 0 if spot.y <= 2 else spot.y, spot.width + 1, 1)
            self.scroll_to_region(region, animate=False, immediate=True, force=True)
