"""The Pelican with a depth camera, or a 3D scanner, among what stands in its way: around it, before it, and, without one, in it."""

from pathlib import Path

import pytest
from tests.flight import among_obstacles as courses
from tests.flight import seen_in_depth as depth
from tests.flight.card import ONE_STYLE, Card

SEED = 7

pytestmark = [pytest.mark.thorough, ONE_STYLE]


def test_it_flies_around_a_box_that_its_depth_camera_shows(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, depth.behind_a_box(), tmp_path, platform=depth.depth_platform(), seed=SEED)
    assert flight.state("sweep") == "done"
    assert ruler.nearest.hull_m >= courses.NEAREST_M


def test_without_a_depth_camera_it_ends_in_the_box(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, depth.behind_a_box(), tmp_path, platform="pelican_rtk", seed=SEED)
    assert ruler.nearest.hull_m < 0.0


def test_what_has_left_the_view_beside_it_is_remembered(flight: Card, tmp_path: Path) -> None:
    """Without a memory it turns back to its path too early."""
    ports = "trigger: cloud, ports: {cloud: cloud/front}"
    assert ports in depth.depth_platform()
    forgetful = depth.depth_platform().replace(ports, f"{ports}, settings: {{memory_s: 0}}")
    ruler = courses.fly(flight, depth.behind_a_box(), tmp_path, platform=forgetful, seed=SEED)
    assert ruler.nearest.hull_m < courses.NEAREST_M


def test_when_its_camera_is_lost_it_stops_and_flies_on_when_it_is_back(flight: Card, tmp_path: Path) -> None:
    lost = ["device:depth_camera=lost@9..14"]
    ruler = courses.fly(flight, depth.behind_a_box(), tmp_path, platform=depth.depth_platform(), seed=SEED, faults=lost)
    assert flight.state("sweep") == "done"
    assert ruler.nearest.hull_m >= courses.NEAREST_M
    standing = [x for t_s, (x, _, _) in ruler.places_m if 12.0 < t_s < 14.0]
    assert max(standing) - min(standing) < 0.2


def test_where_no_way_leads_round_it_stops_before_it_and_says_so(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, depth.before_a_wall(), tmp_path, platform=depth.depth_platform(), seed=SEED)
    assert flight.state("sweep") == "failed"
    assert flight.was_told("an obstacle blocks the path")
    assert ruler.nearest.hull_m >= courses.NEAREST_M


def test_it_flies_around_a_box_that_its_3d_scanner_shows(flight: Card, tmp_path: Path) -> None:
    ruler = courses.fly(flight, depth.behind_a_box(), tmp_path, platform=depth.lidar_platform(), seed=SEED)
    assert flight.state("sweep") == "done"
    assert ruler.nearest.hull_m >= courses.NEAREST_M


def test_when_its_3d_scanner_is_lost_it_stops_and_flies_on_when_it_is_back(flight: Card, tmp_path: Path) -> None:
    lost = ["device:lidar=lost@9..14"]
    ruler = courses.fly(flight, depth.behind_a_box(), tmp_path, platform=depth.lidar_platform(), seed=SEED, faults=lost)
    assert flight.state("sweep") == "done"
    assert ruler.nearest.hull_m >= courses.NEAREST_M
    standing = [x for t_s, (x, _, _) in ruler.places_m if 12.0 < t_s < 14.0]
    assert max(standing) - min(standing) < 0.2
