"""Candidates of the correlative search: those that may win, and no others."""

import numpy as np

from gloc3_onboard.algorithms.scan_matching.correlative import BEST, SearchWindow, candidates
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

WINDOW = SearchWindow(1.6, 0.8)


def room(*corners: tuple[float, float]) -> Array:
    """Points on the walls between corners, every 5 cm."""
    walls = []
    for begin, end in zip(np.array(corners), np.array((*corners[1:], corners[0])), strict=True):
        count = int(np.linalg.norm(end - begin) / 0.05)
        walls.append(begin + (end - begin) * np.linspace(0.0, 1.0, count, endpoint=False)[:, None])
    return np.concatenate(walls)


def test_a_place_that_gathers_much_less_than_the_best_is_no_candidate() -> None:
    walls = room((-3.0, -2.0), (4.0, -2.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (-3.0, 3.0))
    true = Planar(0.3, -0.2, 0.2)
    found = candidates(true.inverse().apply(walls), walls, Planar(), WINDOW)
    assert 1 <= len(found) < BEST
    assert (true.inverse() @ found[0]).distance_m < 0.25


def test_places_that_look_alike_are_all_candidates() -> None:
    """A comb of equal niches, 1.2 m apart: a scan of two of them fits one niche on as well."""
    teeth = [(0.6 * i, 1.0 + 0.5 * (i // 1 % 2)) for i in range(-8, 9) for _ in (0, 1)]
    steps = [
        (x, before[1]) if k % 2 else (x, y)
        for k, ((x, y), before) in enumerate(zip(teeth, (teeth[0], *teeth), strict=False))
    ]
    walls = room(*steps)[: -int(9.6 / 0.05)]
    scan = walls[np.abs(walls[:, 0]) < 1.5]
    along = {round(place.x_m / 1.2) for place in candidates(scan, walls, Planar(), WINDOW, prior=0.02)}
    assert {-1, 0, 1} <= along
