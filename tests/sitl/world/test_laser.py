"""The laser scanner: ranges worked out by hand, tilt, boxes, noise, drop-outs, the time of a turn."""

from collections.abc import Callable
from math import cos, hypot, pi

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.messages.perception import LaserScan
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.laser import LaserModel, LaserScanner

TruthAt = Callable[..., Truth]
CLEAN = LaserModel(noise_m=0.0, drop_out=0.0)
HOLD = World.load("hold")
PLAIN = World(msgspec.structs.replace(HOLD.file, boxes={}, marker=None))


def ranges(scan: LaserScan) -> NDArray[np.float32]:
    return np.frombuffer(scan.ranges_m, "<f4")


def beam(angle_rad: float) -> int:
    """The number of the default scanner's beam at an angle to the left."""
    return round((angle_rad + pi) / (2.0 * pi / 360.0))


def test_a_level_scan_is_the_outline_of_the_hold(truth_at: TruthAt) -> None:
    """In the middle of a rectangle each range is the least of the two walls ahead over the cosines."""
    x_m, y_m = 7.0, 4.0
    scan = LaserScanner(PLAIN, CLEAN).scan(truth_at(PLAIN, (x_m, y_m, 4.0)))
    angles = scan.angle_min_rad + scan.angle_step_rad * np.arange(360)
    with np.errstate(divide="ignore"):
        along = np.where(np.cos(angles) > 0.0, (21.0 - x_m) / np.cos(angles), (-3.0 - x_m) / np.cos(angles))
        aside = np.where(np.sin(angles) > 0.0, (13.0 - y_m) / np.sin(angles), (-3.0 - y_m) / np.sin(angles))
    assert ranges(scan) == pytest.approx(np.minimum(np.abs(along), np.abs(aside)), abs=2e-5)


def test_the_first_beam_looks_back_and_they_go_to_the_left(truth_at: TruthAt) -> None:
    scan = LaserScanner(PLAIN, CLEAN).scan(truth_at(PLAIN, (7.0, 4.0, 4.0), (0.0, 0.0, pi / 2.0)))
    found = ranges(scan)
    assert [found[beam(angle)] for angle in (0.0, pi / 2.0, -pi / 2.0, -pi)] == pytest.approx([7.0, 14.0, 10.0, 9.0])


def test_a_tilted_scanner_sees_farther_on_the_wall_and_then_the_floor(truth_at: TruthAt) -> None:
    scanner = LaserScanner(PLAIN, CLEAN)
    tilted = scanner.true_ranges_m(truth_at(PLAIN, (7.0, 4.0, 4.0), (0.2, 0.0, 0.0)))
    assert tilted[beam(pi / 2.0)] == pytest.approx(hypot(9.0, 9.0 * np.tan(0.2)), abs=0.02)
    height_m = 4.0 + 0.0973 + 0.08 * cos(0.3)
    down = scanner.true_ranges_m(truth_at(PLAIN, (7.0, 4.0, 4.0), (0.0, -0.3, 0.0)))[beam(-pi)]
    assert down == pytest.approx(min(10.0 / cos(0.3), height_m / np.sin(0.3)), abs=0.03)


def test_boxes_stand_before_walls(truth_at: TruthAt) -> None:
    scanner = LaserScanner(HOLD, CLEAN)
    found = scanner.true_ranges_m(truth_at(HOLD, (16.0, 8.0, 1.5)))
    assert found[beam(pi / 2.0)] == pytest.approx(11.2 - 8.0)
    above = scanner.true_ranges_m(truth_at(HOLD, (16.0, 8.0, 3.0)))
    assert above[beam(pi / 2.0)] == pytest.approx(13.0 - 8.0)


def test_noise_and_drop_outs_are_as_stated(truth_at: TruthAt) -> None:
    model = LaserModel(noise_m=0.02, drop_out=0.05)
    scanner = LaserScanner(PLAIN, model, seed=4)
    truth = truth_at(PLAIN, (7.0, 4.0, 4.0))
    true_m = scanner.true_ranges_m(truth)
    scans = [ranges(scanner.scan(msgspec.structs.replace(truth, t_s=0.1 * n))) for n in range(40)]
    lost = np.array([scan >= 30.0 for scan in scans])
    errors = np.array([scan - true_m for scan in scans])[~lost]
    assert lost.mean() == pytest.approx(0.05, abs=0.008)
    assert errors.std() == pytest.approx(0.02, rel=0.05)
    assert errors.mean() == pytest.approx(0.0, abs=0.001)


def test_what_is_too_near_or_too_far_is_nothing_seen(truth_at: TruthAt) -> None:
    short = msgspec.structs.replace(CLEAN, range_max_m=5.6)
    far = ranges(LaserScanner(PLAIN, short).scan(truth_at(PLAIN, (9.0, 5.0, 4.0))))
    assert (far == np.float32(5.6)).all(), "in the middle of the hold a short scanner sees nothing"
    near = ranges(LaserScanner(PLAIN, CLEAN).scan(truth_at(PLAIN, (20.95, 5.0, 4.0))))
    assert near[beam(0.0)] == np.float32(30.0)
    assert near[beam(1.3)] == pytest.approx(0.05 / cos(1.3), abs=0.01)


def test_a_scan_depends_on_seed_and_time_and_on_nothing_before(truth_at: TruthAt) -> None:
    truth = truth_at(PLAIN, (7.0, 4.0, 4.0))
    later = msgspec.structs.replace(truth, t_s=2.0)
    first, other = LaserScanner(PLAIN, LaserModel(), 1), LaserScanner(PLAIN, LaserModel(), 2)
    whole = first.scan(truth), first.scan(later)
    assert LaserScanner(PLAIN, LaserModel(), 1).scan(later) == whole[1]
    assert whole[0] != whole[1]
    assert other.scan(truth) != whole[0]


def test_a_turn_that_takes_time_is_skewed_by_the_motion(truth_at: TruthAt) -> None:
    slow = msgspec.structs.replace(CLEAN, duration_s=0.1)
    still = truth_at(PLAIN, (7.0, 4.0, 4.0))
    moving = msgspec.structs.replace(still, velocity_ned_m_s=(1.0, 0.0, 0.0))
    scanner = LaserScanner(PLAIN, slow)
    calm, skewed = scanner.true_ranges_m(still), scanner.true_ranges_m(moving)
    ahead = beam(0.0)
    assert skewed[ahead] - calm[ahead] == pytest.approx(0.05, abs=0.001), (
        "half a turn before its end it was 5 cm behind"
    )
    assert skewed[359] == pytest.approx(calm[359], abs=1e-6)
    turning = msgspec.structs.replace(still, rate_frd_rad_s=(0.0, 0.0, 0.5))
    angles = np.deg2rad(np.arange(360) - 180.0)
    expected = LaserScanner(PLAIN, CLEAN).true_ranges_m(truth_at(PLAIN, (7.0, 4.0, 4.0), (0.0, 0.0, -0.5 * 0.1 * 0.5)))
    near = np.abs(angles - 0.0) < 0.02
    assert scanner.true_ranges_m(turning)[near] == pytest.approx(expected[near], abs=0.01)


def test_a_corridor_looks_the_same_to_the_scanner_all_along(truth_at: TruthAt) -> None:
    corridor = World.load("corridor")
    scanner = LaserScanner(corridor, CLEAN)
    here, there = (ranges(scanner.scan(truth_at(corridor, (x_m, 0.3, 1.5)))) for x_m in (-5.0, 5.0))
    assert here == pytest.approx(there, abs=1e-4)
    assert here.min() == pytest.approx(0.9, abs=1e-4)
    assert 4 <= (here >= 30.0).sum() <= 20, "straight along it nothing is seen"
