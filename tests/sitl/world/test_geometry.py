"""The shape of a world: rays, distances, lines of sight and coverage against what can be worked out by hand."""

from math import cos, inf, pi, sqrt, tan

import msgspec
import numpy as np
import pytest
from tests.evidence.coverage import Coverage

from gloc3.messages.frames import IDENTITY, Vector3, from_euler
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.geometry import Geometry
from gloc3_sitl.world.model import Box, Shuttle, Surface
from gloc3_sitl.world.placing import Place

FLOOR = Surface(corner_m=(4.0, 4.0, 0.0), across_m=(0.0, -8.0, 0.0), down_m=(-8.0, 0.0, 0.0), texture="any")
CRATE = Box(min_m=(1.0, -0.5, 0.0), max_m=(2.0, 0.5, 1.0), texture="any")
CART = Box(
    min_m=(-3.0, -0.5, 0.0),
    max_m=(-2.0, 0.5, 1.0),
    texture="any",
    shuttle=Shuttle(by_m=(0.0, 3.0, 0.0), period_s=10.0),
)
YARD = Geometry([FLOOR], [CRATE, CART])


def ray(origin_m: Vector3, direction: Vector3, t_s: float = 0.0) -> float:
    unit = np.array([direction]) / np.linalg.norm(direction)
    found = float(YARD.ranges(np.array(origin_m), unit, t_s)[0])
    x, y, z = unit[0].tolist()
    assert YARD.range_m(origin_m, (x, y, z), t_s) == pytest.approx(found, abs=1e-9)
    return found


@pytest.mark.parametrize(
    ("origin_m", "direction", "expected_m"),
    [
        ((0.0, 0.0, 2.0), (0.0, 0.0, -1.0), 2.0),
        ((0.0, 0.0, 2.0), (1.0, 0.0, -1.0), sqrt(2.0)),
        ((0.0, 0.0, 0.5), (1.0, 0.0, 0.0), 1.0),
        ((0.0, 0.0, 0.5), (-1.0, 0.0, 0.0), 2.0),
        ((0.0, 0.0, 0.5), (0.0, 1.0, 0.0), inf),
        ((0.0, 0.0, 2.0), (0.0, 0.0, 1.0), inf),
        ((1.5, 0.0, 3.0), (0.0, 0.0, -1.0), 2.0),
        ((5.0, 0.0, 2.0), (0.0, 0.0, -1.0), inf),
        ((1.5, 0.0, 0.5), (1.0, 0.0, 0.0), 0.5),
    ],
)
def test_a_ray_ends_where_geometry_says(origin_m: Vector3, direction: Vector3, expected_m: float) -> None:
    assert ray(origin_m, direction) == pytest.approx(expected_m, abs=1e-9)


def test_a_box_that_moves_is_met_where_it_is_at_the_time() -> None:
    times_s = (0.0, 1.0, 2.5, 5.0, 7.5, 10.0)
    met = [ray((-2.5, -4.0, 0.5), (0.0, 1.0, 0.0), t_s) for t_s in times_s]
    expected = [3.5 + 3.0 * (0.5 - 0.5 * cos(2.0 * pi * t_s / 10.0)) for t_s in times_s]
    assert met == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("point_m", "t_s", "expected_m"),
    [
        ((0.0, 0.0, 0.3), 0.0, 0.3),
        ((0.4, 0.0, 0.9), 0.0, 0.6),
        ((0.4, 0.0, 1.8), 0.0, 1.0),
        ((1.5, 0.0, 0.5), 0.0, 0.0),
        ((7.0, 0.0, 4.0), 0.0, 5.0),
        ((-2.5, 0.0, 1.4), 0.0, 0.4),
        ((-2.5, 0.0, 1.4), 5.0, 1.4),
    ],
)
def test_clearance_is_the_distance_to_the_nearest_thing(point_m: Vector3, t_s: float, expected_m: float) -> None:
    assert YARD.clearance_m(point_m, t_s) == pytest.approx(expected_m, abs=1e-9)


def test_clearance_agrees_with_the_nearest_of_many_rays_in_every_world() -> None:
    random = np.random.default_rng(5)
    for name, low, high in (("hold", (-2, -2, 0.5), (20, 12, 9)), ("tank", (-1, -1, 1), (13, 7, 5))):
        geometry = World.load(name).geometry
        for point in random.uniform(low, high, (12, 3)):
            directions = random.standard_normal((4000, 3))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            nearest_m = float(geometry.ranges(point, directions, 0.0).min())
            clearance_m = geometry.clearance_m((float(point[0]), float(point[1]), float(point[2])), 0.0)
            assert clearance_m <= nearest_m + 1e-9
            assert clearance_m == pytest.approx(nearest_m, rel=0.03, abs=0.02)


def test_what_stands_behind_a_box_is_hidden_and_what_lies_on_it_is_not() -> None:
    targets = np.array([[3.0, 0.0, 0.2], [1.0, 0.0, 0.5], [3.0, 2.0, 0.2], [3.0, 0.0, 2.6]])
    assert YARD.is_clear((0.0, 0.0, 0.5), targets, 0.0).tolist() == [False, True, True, True]


def test_a_world_says_how_high_slopes_boxes_and_hanging_girders_are() -> None:
    hold = World.load("hold")
    assert hold.height_at(5.0, 12.55) == pytest.approx(0.6)
    assert hold.height_at(5.0, 12.1) == pytest.approx(0.0, abs=1e-9)
    assert hold.height_at(15.0, 12.0) == 2.5, "the container stands before the slope"
    tank = World.load("tank")
    assert tank.height_at(3.9, 2.0) == 6.0
    assert tank.height_at(3.9, 2.0, below_m=2.0) == 0.0, "one can be under a girder"
    busy = World.load("hold_busy")
    assert [busy.height_at(8.5, 7.5, t_s) for t_s in (0.0, 15.0, 30.0)] == [3.5, 0.0, 3.5]


def look_ahead(position_m: Vector3, yaw_rad: float = 0.0) -> Place:
    """A camera that looks along x turned to the left."""
    turn = from_euler(0.0, 0.0, -yaw_rad)
    return Place((0.0, 1.0, 0.0, 0.0), position_m).mounted((0.0, 0.0, 0.0), turn).mounted((0.0, 0.0, 0.0), (0.5,) * 4)


def test_coverage_counts_the_part_of_the_wall_that_is_in_the_picture() -> None:
    hold = World.load("hold")
    camera = msgspec.structs.replace(rig.GROUND, frd_from_rdf=IDENTITY)
    cells = Coverage(hold, "port", cell_m=0.1, range_max_m=8.0)
    shown = cells.look(camera, look_ahead((8.0, 10.0, 5.0), pi / 2.0), 0.0)
    width_m, height_m = 3.0 * camera.width / 400.0, 3.0 * camera.height / 400.0
    assert shown.sum() * 0.01 == pytest.approx(width_m * height_m, rel=0.03)
    seen = cells.centers_m[shown]
    assert (seen[:, 0].min(), seen[:, 0].max()) == pytest.approx((8.0 - width_m / 2, 8.0 + width_m / 2), abs=0.1)
    assert (seen[:, 2].min(), seen[:, 2].max()) == pytest.approx((5.0 - height_m / 2, 5.0 + height_m / 2), abs=0.1)
    assert cells.share == pytest.approx(width_m * height_m / 240.0, rel=0.03)
    cells.look(camera, look_ahead((8.0, 10.0, 5.0), pi / 2.0), 0.0)
    assert cells.counts.max() == 2
    assert cells.share == pytest.approx(width_m * height_m / 240.0, rel=0.03), "twice seen is seen once"


def test_coverage_leaves_out_what_is_hidden_far_oblique_or_behind() -> None:
    hold = World.load("hold")
    camera = msgspec.structs.replace(rig.GROUND, frd_from_rdf=IDENTITY)
    behind_crates = Coverage(hold, "port", cell_m=0.1, range_max_m=8.0)
    shown = behind_crates.look(camera, look_ahead((16.5, 9.0, 1.5), pi / 2.0), 0.0)
    low = behind_crates.centers_m[..., 2] < 2.0
    middle = np.abs(behind_crates.centers_m[..., 0] - 16.5) < 1.0
    assert not shown[low & middle].any(), "the container hides it"
    assert shown[~low & middle & (behind_crates.centers_m[..., 2] < 3.5)].sum() > 0
    away = Coverage(hold, "port", range_max_m=8.0)
    assert not away.look(camera, look_ahead((8.0, 10.0, 5.0), -pi / 2.0), 0.0).any()
    assert not away.look(camera, look_ahead((8.0, 4.0, 5.0), pi / 2.0), 0.0).any(), "too far"
    oblique = Coverage(hold, "port", range_max_m=30.0, incidence_max_rad=1.0)
    shown = oblique.look(camera, look_ahead((0.0, 12.0, 5.0), 0.4), 0.0)
    assert shown.any()
    off = oblique.centers_m[shown] - (0.0, 12.0, 5.0)
    assert np.hypot(off[:, 0], off[:, 2]).max() <= tan(1.0) + 1e-9
