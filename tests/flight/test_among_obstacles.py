"""The inspection vehicle among boxes, along a wall and in a duct: every figure of its page of evidence, with one seed."""

from pathlib import Path

import pytest
from tests.flight import among_obstacles as courses
from tests.flight.card import ONE_STYLE, Card
from tests.flight.test_flying_on_our_own_pose import errors_m

from gloc3.messages.frames import Vector3

SEED = 7
TRACKER_M = (20.6, -2.6, 9.2)

pytestmark = [pytest.mark.thorough, ONE_STYLE]


def hidden_at(place_m: Vector3) -> str:
    """A plate that hides the lamp from the tracker around a place."""
    share = 0.4
    x, y, height = (t + share * (p - t) for t, p in zip(TRACKER_M, place_m, strict=True))
    return courses.box("plate", x, y, (0.5, 0.6), height + 0.1, low_m=height - 0.1)


def test_it_passes_boxes_and_one_that_moves_with_half_a_metre_between(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, courses.among_boxes(SEED), tmp_path, platform=courses.scanner_platform(), seed=SEED)
    assert flight.state("sweep") == "done"
    assert ruler.nearest.hull_m >= courses.NEAREST_M


def test_a_limiter_that_is_told_of_nothing_comes_too_near(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, courses.among_boxes(SEED), tmp_path, platform="pelican_rtk", seed=SEED)
    assert ruler.nearest.hull_m < courses.NEAREST_M


def test_where_no_way_leads_round_it_stays_away_and_says_so(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, courses.without_a_way(SEED), tmp_path, platform=courses.scanner_platform(), seed=SEED)
    assert flight.state("sweep") == "failed"
    assert flight.was_told("an obstacle blocks the path")
    assert ruler.nearest.hull_m >= courses.NEAREST_M


def test_along_a_wall_it_keeps_its_distance_takes_pictures_and_finds_its_lamp_again(
    flight: Card, tmp_path: Path
) -> None:
    plan = courses.along_the_wall(SEED)
    world = courses.SIDE_WORLD + "boxes:\n" + hidden_at((3.0, -1.2, 2.0)) + "\n"
    ruler = courses.fly(flight, courses.Course(world, plan.course.mission), tmp_path, seed=SEED, out=tmp_path / "run")
    assert flight.state("sweep") == "done"
    assert courses.off_the_wall_m(ruler.places_m, plan.distance_m) <= 0.15
    fixes = [(each.t_s, each.payload) for each in flight.received["position_fix/tracker"]]
    lamp = courses.lost_and_found(ruler.in_sight, fixes)
    assert lamp["hidden_s"] >= 1.0
    assert (lamp["wrong"], lamp["found_s"] <= 0.5) == (0, True)
    assert max(errors_m(flight)) <= 0.15
    used = flight.received["image_recorded"]
    assert len(used) > 8
    assert {each.payload.camera for each in used} == {"front_left"}


def test_in_a_duct_the_laser_says_that_it_does_not_know_how_far_it_came(flight: Card, tmp_path: Path) -> None:
    course = courses.through_the_duct(SEED, 2.0)
    courses.fly(flight, course, tmp_path, platform=courses.corridor_platform(), seed=SEED)
    assert flight.state("sweep") == "done"
    reports = [each.payload for each in flight.received["odometry/laser"]]
    ratios, off_deg = courses.corridor_ratios(reports)
    assert len(ratios) > 50
    assert min(ratios) >= 10.0
    assert max(off_deg) <= 10.0
