"""The mission as a graph: tasks as boxes in the order in which they run, their actions inside with live states."""

from typing import Final, NamedTuple

from gloc3.messages.summaries import MissionSummary
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.missions.outline import COMMANDS, Outline, OutlineAction, OutlineTask
from gloc3_groundstation.station import wording
from gloc3_groundstation.tui.graph.canvas import GraphCanvas
from gloc3_groundstation.tui.graph.layout import Layout
from gloc3_groundstation.tui.graph.rails import NODE, RailRow, rail_rows
from gloc3_groundstation.tui.views.mission.lines import SIGNS
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, bar, cut, faded, spread

NARROWEST: Final = 22
"""Columns of a box, frame included, at least."""
WIDEST: Final = 46
FRAMES: Final = {
    ActionState.RUNNING: Tone.BUSY,
    ActionState.PAUSED: Tone.WARN,
    ActionState.FAILED: Tone.BAD,
    ActionState.ABORTED: Tone.BAD,
}
UNSTATED: Final = ("○", Tone.DIM)
"""Sign of an item that is not on any vehicle yet."""


class GraphSpot(NamedTuple):
    """Position of an item in the drawing."""

    target: str
    """Empty for the mission."""
    x: int
    y: int
    width: int
    layer: int


class Graph(NamedTuple):
    """The drawing of a mission."""

    lines: list[Line]
    spots: tuple[GraphSpot, ...]
    width: int

    def spot(self, target: str) -> GraphSpot | None:
        """Position of an item."""
        return next((spot for spot in self.spots if spot.target == target), None)


def sign_of(state: str) -> tuple[str, Tone]:
    """The sign of a state, and its tone."""
    return SIGNS.get(state, UNSTATED)


def mission_graph(outline: Outline, reported: MissionSummary | None, width: int, *, is_stale: bool = False) -> Graph:
    """Draws a mission as a graph.

    Args:
        outline: its order.
        reported: its states on the platform that holds it; None for a mission that is on no platform.
        width: available columns; the graph may be wider.
        is_stale: whether the states are stale.
    """
    states = reported.tasks if reported is not None else {}
    stages = {stage.name: stage for stage in outline.stages}
    rows = {stage.name: _rails(stage) for stage in outline.stages}
    before: dict[str, tuple[str, ...]] = {}
    last = ""
    for stage in outline.stages:
        known = stage.after if outline.is_ordered else (last,) if last else ()
        before[stage.name] = known
        last = stage.name
    layout = Layout(before, {name: _height(found) for name, found in rows.items()})
    natural = max((_natural(stage, rows[stage.name]) for stage in outline.stages), default=NARROWEST)
    least = max(NARROWEST, min(natural, WIDEST - 10))
    box = max(NARROWEST if layout.widest(width - 2) >= NARROWEST else least, min(layout.widest(width - 2), WIDEST))
    canvas = GraphCanvas()
    spots = [GraphSpot("", 0, 0, width, -1)]
    frames = {stage.name: _frame_tone(states.get(stage.name, "")) for stage in outline.stages}
    for name, place in layout.places(box, 1, 2).items():
        _draw_box(canvas, stages[name], rows[name], reported, (place.x, place.y, box), frames[name])
        spots.append(GraphSpot(name, place.x, place.y, box, place.layer))
        for index, row in enumerate(rows[name]):
            if row.name:
                spots.append(GraphSpot(f"{name}.{row.name}", place.x + 1, place.y + 1 + index, box - 2, place.layer))
    if outline.is_ordered:
        layout.draw_wires(canvas, box, 1, 2, lambda name: frames[name])
    lines = canvas.lines()
    lines[:2] = [mission_line(outline, reported, width, is_wider=canvas.width > width), EMPTY]
    return Graph([faded(line) for line in lines] if is_stale else lines, tuple(spots), canvas.width + 1)


def mission_line(outline: Outline, reported: MissionSummary | None, width: int, *, is_wider: bool = False) -> Line:
    """The mission as a whole: its name, its state, how much is done, and how long it takes."""
    state = reported.state if reported is not None else ""
    sign, tone = sign_of(state)
    right: list[Span] = []
    if reported is not None and state:
        own = [target for target in outline.targets() if "." in target and not target.startswith(COMMANDS)]
        ended = sum(reported.tasks.get(target) in ("done", "skipped") for target in own)
        right.append(Span(f"{ended} of {len(own)} actions done", Tone.DIM))
        right.append(Span(f"   {state}", tone))
    if outline.duration_s is not None:
        about = "about" if outline.least is None else "up to"
        right.append(Span(f"   {about} {wording.duration(outline.duration_s)}", Tone.DIM))
    right.append(Span("   ◂ ▸ " if is_wider else " ", Tone.KEY))
    room = width - sum(len(span.text) for span in right) - 6
    left = (Span(" "), Span(f"{sign} ", tone), Span(cut(outline.title, max(12, room)), Tone.STRONG))
    return spread(left, tuple(right), width)


def _draw_box(
    canvas: GraphCanvas,
    stage: OutlineTask,
    rows: list[RailRow],
    reported: MissionSummary | None,
    place: tuple[int, int, int],
    frame: Tone,
) -> None:
    x, y, width = place
    canvas.box(x, y, width, _height(rows), frame)
    state = reported.tasks.get(stage.name, "") if reported is not None else ""
    sign, tone = sign_of(state)
    word = f" {state} " if state else ""
    name = cut(stage.name, width - 8 - len(word))
    canvas.text(x + 1, y, f" {sign} ", tone)
    canvas.text(x + 4, y, f"{name} ", Tone.DIM if state in ("waiting", "skipped") else Tone.STRONG)
    if word:
        canvas.text(x + width - 2 - len(word), y, word, tone)
    for index, row in enumerate(rows):
        step = next((one for one in stage.steps if one.name == row.name), None)
        inner = (x + 2, y + 1 + index, width - 4)
        if step is None:
            canvas.text(inner[0], inner[1], row.rails, Tone.DIM)
        else:
            _draw_step(canvas, step, row, reported, inner)


def _draw_step(
    canvas: GraphCanvas, step: OutlineAction, row: RailRow, reported: MissionSummary | None, place: tuple[int, int, int]
) -> None:
    x, y, width = place
    state = reported.tasks.get(step.target, "") if reported is not None else ""
    sign, tone = sign_of(state)
    canvas.text(x, y, row.rails, Tone.DIM)
    canvas.text(x + row.rails.index(NODE), y, sign, tone)
    left = x + len(row.rails)
    room = width - len(row.rails)
    progress = reported.progress.get(step.target) if reported is not None else None
    word = state
    if progress and state in ("running", "paused"):
        percent = f"{progress * 100:.0f} %"
        spare = room - len(step.name) - len(percent) - 3
        word = percent if state == "running" else f"paused {percent}"
        if state == "running" and spare >= 6:
            word = f"{bar(progress, min(16, spare))} {percent}"
    elif not state and step.duration_s is not None:
        word = wording.duration(step.duration_s)
    name = cut(step.name, room - len(word) - 1)
    canvas.text(left, y, name, Tone.DIM if state in ("", "waiting", "skipped") else Tone.TEXT)
    until = f" until {step.until}"
    if step.until and len(name) + len(until) + len(word) + 1 <= room:
        canvas.text(left + len(name), y, until, Tone.DIM)
    canvas.text(x + width - len(word), y, word, tone)


def _rails(stage: OutlineTask) -> list[RailRow]:
    return rail_rows({step.name: step.after for step in stage.steps})


def _height(rows: list[RailRow]) -> int:
    """Lines of a box; one whose actions are all unusable has an empty line."""
    return max(1, len(rows)) + 2


def _natural(stage: OutlineTask, rows: list[RailRow]) -> int:
    """The width at which nothing of a box is cut."""
    inside = max((len(row.rails) + len(row.name) for row in rows), default=0) + 9
    return max(inside + 4, len(stage.name) + 16)


def _frame_tone(state: str) -> Tone:
    return FRAMES.get(ActionState(state), Tone.DIM) if state in list(ActionState) else Tone.DIM
