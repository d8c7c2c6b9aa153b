"""The judge of flights: right figures for right flights, red ones for wrong flights."""

import itertools
import math

from gloc3.messages.frames import Vector3
from gloc3_sitl.flight.path_error import PathResult, TruthSample, path_error

SQUARE: list[Vector3] = [(0.0, 0.0, -2.0), (10.0, 0.0, -2.0), (10.0, 10.0, -2.0), (0.0, 10.0, -2.0)]


def fly(points: list[Vector3], speed_m_s: float = 0.5) -> list[TruthSample]:
    samples, t_s = [], 0.0
    for a, b in itertools.pairwise(points):
        steps = max(1, round(math.dist(a, b) / speed_m_s * 10))
        for step in range(steps):
            share = step / steps
            x, y, z = (p + (q - p) * share for p, q in zip(a, b, strict=True))
            samples.append(TruthSample(t_s, (x, y, z)))
            t_s += 0.1
    return [*samples, TruthSample(t_s, points[-1])]


def judge(points: list[Vector3], **kwargs: float) -> PathResult:
    return path_error(fly(points, **kwargs), SQUARE)


def test_a_perfect_flight_has_no_error_and_passes_everything() -> None:
    result = judge(SQUARE)
    assert result.rms_m < 1e-6
    assert result.is_complete
    assert result.slowest_m_s > 0.49


def test_a_flight_beside_the_way_shows_its_distance() -> None:
    shifted: list[Vector3] = [(n, e, d - 0.2) for n, e, d in SQUARE]
    result = judge(shifted)
    assert abs(result.rms_m - 0.2) < 1e-6
    assert abs(result.max_m - 0.2) < 1e-6


def test_a_flight_that_hovers_is_red() -> None:
    result = path_error([TruthSample(0.1 * i, SQUARE[0]) for i in range(600)], SQUARE)
    assert result.passed == 0
    assert result.slowest_m_s == 0.0


def test_a_flight_that_skips_a_leg_is_red() -> None:
    result = judge([SQUARE[0], SQUARE[2], SQUARE[3]])
    assert not result.is_complete
    assert result.max_m > 1.0


def test_a_flight_that_cuts_corners_is_red() -> None:
    cut: list[Vector3] = [
        (0.0, 0.0, -2.0),
        (8.5, 0.0, -2.0),
        (10.0, 1.5, -2.0),
        (10.0, 8.5, -2.0),
        (8.5, 10.0, -2.0),
        (0.0, 10.0, -2.0),
    ]
    result = judge(cut)
    assert result.passed == 0
    assert result.max_m > 0.5


def test_a_slow_leg_shows() -> None:
    assert judge(SQUARE, speed_m_s=0.4).slowest_m_s < 0.45


def test_what_turns_wide_passes_a_waypoint_in_a_wider_circle_and_may_end_within_it() -> None:
    wide: list[Vector3] = [
        (0.0, 0.0, -2.0),
        (11.5, 0.0, -2.0),
        (12.5, 2.0, -2.0),
        (10.0, 5.0, -2.0),
        (10.0, 11.5, -2.0),
        (5.0, 10.0, -2.0),
        (1.0, 10.0, -2.0),
    ]
    assert not judge(wide).is_complete
    result = path_error(fly(wide), SQUARE, near_m=2.5)
    assert result.is_complete
    assert result.slowest_m_s > 0.3
    assert 0.3 < result.rms_m < 1.5
