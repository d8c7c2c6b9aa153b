"""The inspection vehicle behind a wall of boxes, by its own map: figures of the page of evidence, with one seed."""

from pathlib import Path

import pytest
from tests.flight import planned
from tests.flight.among_obstacles import HULL_M
from tests.flight.card import ONE_STYLE, Card

SEED = 3

pytestmark = [pytest.mark.thorough, ONE_STYLE]


def test_it_finds_the_gap_of_the_wall_and_never_comes_nearer_than_the_margin(flight: Card, tmp_path: Path) -> None:
    ruler = planned.fly(flight, {"out": planned.go_to(10.0, 1.0)}, tmp_path, seed=SEED)
    assert flight.state("sweep") == "done"
    assert ruler.nearest.hull_m + HULL_M >= planned.KEEP_M
    found = flight.received["map"][-1].payload
    match = planned.agreement(found, tmp_path / "world.yaml")
    assert match.wrong_free < 0.02
    assert match.wrong_occupied < 0.02


def test_where_the_gap_is_shut_it_says_so(flight: Card, tmp_path: Path) -> None:
    ruler = planned.fly(flight, {"out": planned.go_to(10.0, 1.0)}, tmp_path, (*planned.WALL, planned.SHUT), seed=SEED)
    assert flight.state("sweep") == "failed"
    assert flight.was_told("no way leads to the goal that keeps 1.3 m from everything")
    assert ruler.nearest.hull_m + HULL_M >= planned.KEEP_M
