"""How fast a vehicle may go on near others: who gives way, who brakes, and what is no conflict."""

import pytest

from gloc3.messages.frames import Vector3
from gloc3.messages.neighbours import Neighbour
from gloc3_onboard.algorithms.paths.separation import STALE_S, SeparationRule

RULE = SeparationRule(separation_m=6.0, separation_height_m=3.0, braking_m_s2=1.75)
NORTH: Vector3 = (2.0, 0.0, 0.0)


def other(
    at: Vector3, velocity: Vector3 = (0.0, 0.0, 0.0), *, t_s: float = 0.0, has_priority: bool = True
) -> Neighbour:
    return Neighbour(name="heron", position_ned_m=at, velocity_ned_m_s=velocity, t_s=t_s, has_priority=has_priority)


def share(neighbour: Neighbour, wanted: Vector3 = NORTH, now_s: float = 0.0) -> float:
    return RULE.passage((0.0, 0.0, -4.0), wanted, wanted, [neighbour], now_s).share


def test_a_free_path_is_left_as_it_is() -> None:
    assert share(other((-20.0, 0.0, -4.0))) == 1.0
    assert share(other((40.0, 0.0, -4.0))) == 1.0
    assert share(other((10.0, 12.0, -4.0), NORTH)) == 1.0, "side by side"


def test_who_gives_way_looks_far_ahead_and_who_has_it_brakes_late() -> None:
    crossing = (14.0, -14.0, -4.0), (0.0, 2.0, 0.0)
    assert share(other(*crossing)) < 1.0
    assert share(other(*crossing, has_priority=False)) == 1.0
    close = (9.0, 0.0, -4.0), (-1.0, 0.0, 0.0)
    assert share(other(*close, has_priority=False)) == 0.0
    found = RULE.passage((0.0, 0.0, -4.0), NORTH, NORTH, [other(*close, has_priority=False)], 0.0)
    assert found.name == "heron"
    assert found.distance_m == pytest.approx(9.0)


def test_another_height_is_enough() -> None:
    assert share(other((12.0, 0.0, -4.0))) < 1.0
    assert share(other((12.0, 0.0, -8.0))) == 1.0
    assert share(other((0.0, 0.0, -11.0)), (0.0, 0.0, -2.0)) < 1.0, "nor may it climb into the other"


def test_away_from_one_that_is_too_near_is_always_open() -> None:
    near = other((4.0, 0.0, -4.0))
    assert share(near) == 0.0
    assert share(near, (-2.0, 0.0, 0.0)) == 1.0


def test_of_several_the_worst_counts_and_old_reports_do_not() -> None:
    far, near = other((40.0, 0.0, -4.0)), other((9.0, 0.0, -4.0))
    assert RULE.passage((0.0, 0.0, -4.0), NORTH, NORTH, [far, near], 0.0).share == 0.0
    assert share(near, now_s=STALE_S + 0.1) == 1.0
    assert SeparationRule(0.0, 0.5, 1.75).passage((0.0, 0.0, -4.0), NORTH, NORTH, [near], 0.0).share == 1.0
