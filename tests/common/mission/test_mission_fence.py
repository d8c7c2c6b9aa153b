"""The geofence tells how far inside it points and legs are, also where it is concave."""

from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.mission.model.fence import Area, Fence, polygon_problem

L_SHAPE = Area(polygon_ne_m=((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0)))
ROUND = Area(center_ne_m=(5.0, 5.0), radius_m=3.0)


@pytest.mark.parametrize(
    ("point", "clearance"),
    [((2, 2), 2.0), ((1, 9), 1.0), ((8, 8), -4.0), ((-3, 5), -3.0), ((4, 4), 0.0), ((13, -4), -5.0)],
)
def test_a_polygon_s_clearance_is_positive_inside(point: tuple[float, float], clearance: float) -> None:
    assert L_SHAPE.clearance_m(*point) == pytest.approx(clearance)


@pytest.mark.parametrize(
    ("start", "end", "clearance"),
    [
        ((1, 1), (9, 1), 1.0),
        ((9, 2), (2, 9), -1.0),
        ((8, 3), (3, 8), 0.0),
        ((8, 1), (1, 8), 0.0),
        ((1, 1), (3, 3), 1.0),
        ((-1, 1), (3, 3), -1.0),
    ],
)
def test_a_leg_across_a_notch_leaves_a_concave_polygon(
    start: tuple[float, float], end: tuple[float, float], clearance: float
) -> None:
    found = L_SHAPE.leg_clearance_m(start, end)
    assert found <= max(clearance, 0.0)
    assert (found < 0 or found == 0) if clearance <= 0 else found == pytest.approx(clearance)


def test_circles_and_keep_out_areas_and_the_ceiling_limit_too() -> None:
    fence = Fence(area=Area(center_ne_m=(0.0, 0.0), radius_m=20.0), keep_out=(ROUND, L_SHAPE), ceiling_m=10.0)
    assert fence.clearance_m((-5.0, -5.0, -4.0)) == pytest.approx(6.0)
    assert fence.clearance_m((5.0, 5.0, -4.0)) == pytest.approx(-3.0)
    assert fence.clearance_m((-1.0, -1.0, -11.0)) == pytest.approx(-1.0)
    assert fence.leg_clearance_m((-5.0, 5.0, -4.0), (5.0, 15.0, -4.0)) == pytest.approx(2.0**0.5 * 2.5, abs=4)
    assert fence.leg_clearance_m((15.0, -1.0, -2.0), (-1.0, 15.0, -2.0)) <= 0.0
    assert fence.leg_clearance_m((-5.0, -5.0, -4.0), (-5.0, -5.0, -9.5)) == pytest.approx(0.5)
    assert Fence().clearance_m((1e6, 0.0, 0.0)) == inf


def test_walls_point_towards_the_edges() -> None:
    square = Area(polygon_ne_m=((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))
    assert list(Fence(area=square).walls((1.0, 2.0, -1.0))) == [
        (2.0, (0.0, -1.0)),
        (3.0, (1.0, 0.0)),
        (2.0, (0.0, 1.0)),
        (1.0, (-1.0, 0.0)),
    ]
    assert list(ROUND.walls(6.0, 5.0)) == [(2.0, (1.0, 0.0))]
    assert list(ROUND.walls(10.0, 5.0)) == [(2.0, (-1.0, 0.0))]


@pytest.mark.parametrize(
    ("corners", "problem"),
    [
        (((0, 0), (1, 0), (1, 1)), ""),
        (((0, 0), (1, 1), (1, 0), (0, 1)), "the polygon crosses itself: side 1 meets side 3"),
        (((0, 0), (1, 0), (2, 0)), "the polygon has no area"),
        (((0, 0), (1, 0), (0, 0)), "a polygon has at least three different corners"),
        (L_SHAPE.polygon_ne_m, ""),
    ],
)
def test_polygons_that_cannot_be_used_are_told(corners: tuple[tuple[float, float], ...], problem: str) -> None:
    assert polygon_problem(corners) == problem


COORDINATE = st.floats(-3, 13)
POINT = st.tuples(COORDINATE, COORDINATE)


@given(POINT, POINT, st.sampled_from([L_SHAPE, ROUND]))
@settings(max_examples=100)
def test_no_point_of_a_leg_has_less_clearance_than_the_leg(
    start: tuple[float, float], end: tuple[float, float], area: Area
) -> None:
    leg, gap = area.leg_clearance_m(start, end), area.leg_distance_m(start, end)
    for step in range(21):
        share = step / 20
        clearance = area.clearance_m(start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share)
        if leg > 0:
            assert clearance >= leg - 1e-9
        if gap > 0:
            assert -clearance >= gap - 1e-9
        if clearance < -1e-9:
            assert leg <= 0
        if clearance > 1e-9:
            assert gap <= 0
