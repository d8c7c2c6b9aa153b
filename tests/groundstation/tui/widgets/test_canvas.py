"""The braille raster: every dot in its place, clipped without a trace, one tone a cell, and only changes to draw."""

from math import nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3_groundstation.tui.widgets.canvas import BRAILLE, CellCanvas
from gloc3_groundstation.tui.widgets.lines import Span, Tone, changed_columns, text_of


def picture(canvas: CellCanvas) -> list[str]:
    return [text_of(line).replace(" ", ".") for line in canvas.lines()]


def dots(canvas: CellCanvas) -> set[tuple[int, int]]:
    """Every dot that is set, read back from the characters."""
    places = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3)]
    return {
        (2 * column + x, 4 * row + y)
        for row, line in enumerate(canvas.lines())
        for column, letter in enumerate(text_of(line))
        if ord(letter) >= BRAILLE
        for bit, (x, y) in enumerate(places)
        if (ord(letter) - BRAILLE) >> bit & 1
    }


def test_dots_lines_and_text_stand_where_they_should() -> None:
    canvas = CellCanvas(6, 2)
    canvas.line([(0, 0), (11, 0)], Tone.GOOD)
    canvas.line([(0, 0), (0, 7)], Tone.GOOD)
    canvas.text(3, 1, "hey", Tone.STRONG)
    assert picture(canvas) == ["⡏⠉⠉⠉⠉⠉", "⡇..hey"]


def test_an_empty_canvas_is_blank() -> None:
    assert CellCanvas(3, 2).lines() == [(Span("   "),), (Span("   "),)]


def test_a_cell_has_the_tone_of_what_came_last_and_blanks_need_none() -> None:
    canvas = CellCanvas(5, 1)
    canvas.line([(0, 0), (9, 0)], Tone.DIM)
    canvas.points(np.array([(4.0, 3.0)]), Tone.BAD)
    assert canvas.lines() == [(Span("⠉⠉", Tone.DIM), Span("⡉", Tone.BAD), Span("⠉⠉", Tone.DIM))]
    labelled = CellCanvas(6, 1)
    labelled.text(1, 0, "x", Tone.CHOSEN)
    assert labelled.lines() == [(Span(" "), Span("x", Tone.CHOSEN), Span("    "))]


def test_what_lies_outside_leaves_no_trace() -> None:
    canvas = CellCanvas(4, 2)
    canvas.line([(-50, -50), (-1, 40)], Tone.GOOD)
    canvas.points(np.array([(8.0, 0.0), (0.0, 8.0), (-0.5, 2.0), (nan, 1.0)]), Tone.GOOD)
    canvas.area([(100, 100), (120, 100), (110, 130)], Tone.BAD)
    canvas.text(0, 5, "below", Tone.TEXT)
    canvas.text(-2, 0, "left", Tone.TEXT)
    assert picture(canvas) == ["ft..", "...."]


def test_a_line_across_from_far_away_is_drawn_where_it_passes() -> None:
    canvas = CellCanvas(10, 3)
    canvas.line([(-1e9, 6.0), (1e9, 6.0)], Tone.GOOD)
    assert dots(canvas) == {(x, 6) for x in range(20)}


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(-40, 80), st.floats(-40, 60)), min_size=2, max_size=2))
def test_a_clipped_line_is_the_part_of_the_whole_one(ends: list[tuple[float, float]]) -> None:
    shift = np.array((40.0, 40.0))
    small, large = CellCanvas(20, 6), CellCanvas(60, 30)
    small.line(ends, Tone.GOOD)
    large.line(np.array(ends) + shift, Tone.GOOD)
    inside = {(x - 40, y - 40) for x, y in dots(large) if 40 <= x < 80 and 40 <= y < 64}
    for x, y in dots(small) ^ inside:  # the two are sampled apart: a dot may lie beside
        other = inside if (x, y) not in inside else dots(small)
        at_edge = x in (0, 39) or y in (0, 23)
        assert at_edge or any(abs(x - a) <= 1 and abs(y - b) <= 1 for a, b in other)


def test_a_gap_parts_a_line() -> None:
    canvas = CellCanvas(6, 1)
    canvas.line([(0, 0), (2, 0), (nan, nan), (9, 0), (11, 0)], Tone.GOOD)
    assert dots(canvas) == {(0, 0), (1, 0), (2, 0), (9, 0), (10, 0), (11, 0)}


def test_dashes_stay_with_the_line_when_its_begin_is_off_the_canvas() -> None:
    def dashed(begin: float) -> set[tuple[int, int]]:
        canvas = CellCanvas(10, 1)
        canvas.line([(begin, 1.0), (30.0, 1.0)], Tone.GOOD, on=3, off=2)
        return dots(canvas)

    assert dashed(0.0) == {(x, 1) for x in range(20) if x % 5 < 3}
    assert dashed(-100.0) == dashed(0.0)


@pytest.mark.parametrize("hatch", [1, 3])
def test_an_area_is_filled_or_hatched_and_may_be_concave(hatch: int) -> None:
    canvas = CellCanvas(10, 5)
    canvas.area([(0, 0), (20, 0), (20, 20), (10, 10), (0, 20)], Tone.BAD, hatch=hatch)
    found = dots(canvas)
    assert ((10, 3) in found) is (hatch == 1 or (10 + 3 + 1) % hatch == 0)
    assert (10, 18) not in found
    assert len(found) == pytest.approx(300 / hatch, rel=0.1)


def test_text_says_whether_there_is_room_for_it() -> None:
    canvas = CellCanvas(8, 1)
    canvas.text(3, 0, "ab", Tone.TEXT)
    assert canvas.is_free(0, 0, 3)
    assert not canvas.is_free(1, 0, 3)
    assert not canvas.is_free(6, 0, 3)
    assert not canvas.is_free(0, 1, 1)


def test_only_the_columns_that_differ_are_drawn_again() -> None:
    before = (Span("abc"), Span("def", Tone.GOOD))
    assert changed_columns(before, (Span("abX"), Span("def", Tone.GOOD))) == (2, 3)
    assert changed_columns(before, (Span("abc"), Span("d", Tone.GOOD), Span("ef", Tone.BAD))) == (4, 6)
    assert changed_columns(before, (Span("abc"),)) == (3, 6)
    assert changed_columns(before, before) == (6, 6)
