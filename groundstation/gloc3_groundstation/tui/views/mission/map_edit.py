"""The map's edit mode as drawn: handles, what is carried or drawn, and what the check finds."""

from math import hypot
from typing import Final, NamedTuple

import numpy as np

from gloc3.errors import Finding
from gloc3_groundstation.mapping.handles import Handle, HandleKind, MissionPlaces, Point
from gloc3_groundstation.missions.draft import Draft
from gloc3_groundstation.tui.views.mission.map import RALLY_SIGN, Chart, cell_of, own_place
from gloc3_groundstation.tui.widgets.canvas import CellCanvas
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, cut, wrapped

SIGNS: Final = {
    HandleKind.FENCE: "□",
    HandleKind.CENTER: "□",
    HandleKind.CORNER: "◇",
    HandleKind.PLACE: "○",
    HandleKind.RALLY: RALLY_SIGN,
}
SHOWN_FINDINGS: Final = 8


class EditState(NamedTuple):
    """What the operator is doing with the open mission."""

    places: MissionPlaces | None = None
    """None where the mission is not on this map."""
    chosen: Handle | None = None
    target_ne_m: Point | None = None
    """Where the chosen place is carried to; None while it is not."""
    drawing: str = ""
    """What is drawn: `survey` or `fence`; empty for nothing."""
    corners: tuple[Point, ...] = ()
    """Of that, so far."""
    cursor: tuple[int, int] = (0, 0)
    """Column and line of the crosshair."""
    message: str = ""
    """The reason of the last refusal; empty for none."""

    @property
    def is_busy(self) -> bool:
        """Whether escape ends something before it leaves the edit mode."""
        return bool(self.drawing) or self.target_ne_m is not None or self.chosen is not None


def draw_edit(canvas: CellCanvas, chart: Chart, state: EditState) -> None:
    """Draws handles, and what is carried and drawn, over the map."""
    own, projection = own_place(chart), chart.projection

    def dot(place: Point) -> tuple[float, float]:
        north, east = own.plane_of_ne(np.array([place]))[0]
        return projection.dot(north, east)

    for handle in state.places.handles if state.places is not None else ():
        if handle.kind in SIGNS:
            canvas.text(*cell_of(dot(handle.position_ne_m)), SIGNS[handle.kind], Tone.WARN)
    if state.chosen is not None:
        at = state.target_ne_m or state.chosen.position_ne_m
        if state.target_ne_m is not None and state.places is not None:
            for one in state.places.neighbours(state.chosen):
                canvas.line([dot(one.position_ne_m), dot(at)], Tone.KEY, on=2, off=2)
        canvas.text(*cell_of(dot(at)), "◉", Tone.KEY)
    if state.corners:
        points = [dot(corner) for corner in state.corners]
        column, row = state.cursor
        canvas.line([*points, (column * 2 + 1.0, row * 4 + 2.0), points[0]], Tone.KEY, on=2, off=2)
        for point in points:
            canvas.text(*cell_of(point), "◆", Tone.KEY)
    canvas.text(*state.cursor, "┼", Tone.KEY)


def state_line(state: EditState, draft: Draft | None, outside_m: float, width: int) -> Line:
    """What is done, or the worst that is wrong: one line below the cursor's."""
    if state.message:
        return (Span(cut(f" ✗ {state.message}", width), Tone.BAD),)
    if state.places is None:
        return (Span(cut(" the open mission is not on this map: it has errors, or another frame", width), Tone.WARN),)
    if outside_m > 0.0:
        name = state.chosen.label if state.chosen is not None else "the cursor"
        return (Span(cut(f" ✗ {name} is {outside_m:.1f} m outside the fence", width), Tone.BAD),)
    if state.drawing:
        count = len(state.corners)
        how = "enter on the first corner closes it" if count > 2 else "enter sets a corner"
        return (Span(cut(f" {state.drawing}: {count} corners; {how}", width), Tone.KEY),)
    if state.target_ne_m is not None and state.chosen is not None:
        return (Span(cut(f" {state.chosen.label}: enter places it, esc leaves it", width), Tone.KEY),)
    finding = worst(draft, state.chosen)
    if finding is None:
        return (Span(cut(" no findings; enter picks up the nearest place", width), Tone.GOOD),)
    sign, tone = (" ▲ ", Tone.WARN) if finding.is_warning else (" ✗ ", Tone.BAD)
    return (Span(cut(sign + finding.message, width), tone),)


def rally_line(state: EditState, outside_m: float, *, busy: str, refusal: str, width: int) -> Line:
    """What is done with the rally points, or why the last request was refused."""
    if state.message or refusal:
        return (Span(cut(f" ✗ {state.message or refusal}", width), Tone.BAD),)
    if busy:
        return (Span(cut(f" {busy} …", width), Tone.KEY),)
    if state.places is None:
        return (Span(cut(" the rally points of the vehicle are not known here", width), Tone.WARN),)
    if outside_m > 0.0 and state.chosen is not None:
        return (Span(cut(f" ✗ {state.chosen.label} is {outside_m:.1f} m outside the fence", width), Tone.BAD),)
    if state.target_ne_m is not None and state.chosen is not None:
        return (Span(cut(f" {state.chosen.label}: enter places it, esc leaves it", width), Tone.KEY),)
    return (Span(cut(" i adds a rally point, enter picks up the nearest, ^s uploads them", width), Tone.GOOD),)


def rally_lines(state: EditState, vehicle: str, *, is_changed: bool, width: int) -> list[Line]:
    """The rally points beside the map."""
    lines: list[Line] = [(Span(f" {cut(vehicle, width - 2)}", Tone.STRONG),)]
    lines.append((Span(" not uploaded: ^s uploads", Tone.WARN) if is_changed else Span(" on the vehicle", Tone.DIM),))
    handles = state.places.handles if state.places is not None else ()
    for handle in handles:
        tone = Tone.KEY if handle == state.chosen else Tone.TEXT
        lines.append((Span(f" {RALLY_SIGN} {handle.label}: {handle.height_m:g} m", tone),))
    if not handles:
        lines.append((Span(" none", Tone.DIM),))
    return [*lines, (), (Span(" heights above home", Tone.DIM),)]


def worst(draft: Draft | None, chosen: Handle | None) -> Finding | None:
    """The finding to show first: about the chosen place, else the first error, else the first warning."""
    findings = draft.findings if draft is not None else ()
    line = chosen.line if chosen is not None else 0
    return min(findings, key=lambda one: (one.line != line, one.is_warning, one), default=None)


def edit_lines(state: EditState, draft: Draft | None, width: int) -> list[Line]:
    """The open mission beside the map: the chosen place, and all findings."""
    lines: list[Line] = []
    if draft is not None:
        lines.append((Span(f" {cut(draft.name, width - 2)}", Tone.STRONG),))
        lines.append((Span(" not saved: ^s saves" if draft.is_changed else " saved", Tone.DIM),))
    if state.chosen is not None:
        lines += [(), *((Span(f" {row}", Tone.KEY),) for row in wrapped(state.chosen.label, width - 2))]
        if state.chosen.height_m is not None:
            lines.append((Span(f" height {state.chosen.height_m:g} m"),))
    lines.append(())
    findings = draft.findings if draft is not None else ()
    for finding in sorted(findings, key=lambda one: (one.is_warning, one))[:SHOWN_FINDINGS]:
        sign, tone = ("▲", Tone.WARN) if finding.is_warning else ("✗", Tone.BAD)
        text = finding.message + (f" ({finding.hint})" if finding.hint else "")
        for number, row in enumerate(wrapped(text, max(10, width - 4))):
            lines.append((Span(f" {sign if number == 0 else ' '} ", tone), Span(row)))
    if not findings:
        lines.append((Span(" no findings", Tone.GOOD),))
    if len(findings) > SHOWN_FINDINGS:
        lines.append((Span(f" and {len(findings) - SHOWN_FINDINGS} more", Tone.DIM),))
    return lines


def spacing_m(corners: tuple[Point, ...]) -> float:
    """A spacing for the lines of a survey: a tenth of its area's longest side, in round metres."""
    sides = [hypot(b[0] - a[0], b[1] - a[1]) for a, b in zip(corners, (*corners[1:], corners[0]), strict=True)]
    return max(1.0, round(max(sides) / 10.0))
