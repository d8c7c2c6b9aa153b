"""What could fool the laser odometer: stamps that jump, rooms that look alike, a scanner that is covered for a while."""

from itertools import pairwise
from math import cos, hypot, pi, sin

import numpy as np
import pytest
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner, Wall, box

from gloc3.messages.frames import wrap_pi
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserMotion, LaserOdometer, LaserOdometerSettings
from gloc3_onboard.algorithms.scan_matching.motion_model import MotionModel, MotionModelSettings
from gloc3_onboard.algorithms.scan_matching.planar import Planar

CORNERS = 14
RING = [(5.0 * cos(2.0 * pi * n / CORNERS), 5.0 * sin(2.0 * pi * n / CORNERS)) for n in range(CORNERS + 1)]
ROUND_ROOM: list[Wall] = [*pairwise(RING), *box(3.2, 1.0, 0.5, 0.4), *box(-1.0, -3.8, 0.4, 0.6)]
"""Turned by 25.7 degrees it looks the same, but for two boxes."""


def pillars(first: int, last: int, spacing_m: float = 2.0) -> list[Wall]:
    """A corridor with pillars on both sides, each like the next."""
    walls: list[Wall] = [((-40.0, -1.2), (40.0, -1.2)), ((-40.0, 1.2), (40.0, 1.2))]
    for number in range(first, last):
        walls += box(spacing_m * number, -1.2, 0.3, 0.25) + box(spacing_m * number, 0.95, 0.3, 0.25)
    return walls


def error_of(motion: LaserMotion, pose: Planar) -> Planar:
    return motion.pose.inverse() @ pose


@pytest.mark.parametrize("seed", [1, 2])
def test_a_turn_whose_stamps_are_wrong_once_is_not_taken_for_a_spin(seed: int) -> None:
    """At 10 degrees a scan one stamp comes 50 ms after the one before: a spin by more than a corner of the room seems due."""
    random, odometer = np.random.default_rng(seed), LaserOdometer()
    scanner = Scanner(ROUND_ROOM, angle_min_rad=-pi / 2.0, angle_span_rad=pi)
    heading, stamp_s = 0.0, 0.0
    for number in range(20):
        heading += 0.0 if number < 6 else 0.1
        stamp_s += 0.05 if number == 10 else 0.24
        motion = odometer.update(scanner.scan(Planar(0.0, 0.0, heading), random), stamp_s)
        if number:
            assert motion.is_valid
            assert abs(wrap_pi(motion.pose.yaw_rad - heading)) < 0.02
            assert hypot(*motion.pose[:2]) < 0.03


def test_no_match_moves_the_body_faster_than_it_can() -> None:
    """A corridor of pillars moves on by one of them while the body rests: that looks like the body's own motion."""
    random, odometer = np.random.default_rng(1), LaserOdometer(LaserOdometerSettings(acceleration_m_s2=2.0))
    for number in range(5):
        odometer.update(Scanner(pillars(-6, 7), range_max_m=8.0).scan(Planar(), random), 0.25 * number)
    moved = Scanner(pillars(-6, 7), range_max_m=8.0).scan(Planar(0.6), random)
    motion = odometer.update(moved, 1.25)
    assert motion.pose.distance_m < 0.2
    assert motion.quality < 0.6


def test_a_velocity_changes_no_faster_than_the_body_can() -> None:
    model = MotionModel(MotionModelSettings(acceleration_m_s2=2.0, turn_acceleration_rad_s2=3.0))
    model.update(Planar(0.1, 0.0, 0.02), 0.2)
    model.update(Planar(0.1, 0.0, 0.1), 0.05)
    assert model.velocity == pytest.approx(Planar(0.6, 0.0, 0.25))
    expected = model.expected(0.2, None, None)
    assert expected.motion == pytest.approx(Planar(0.12, 0.0, 0.05))
    assert expected.allows(Planar(0.2, 0.05, 0.1))
    assert not expected.allows(Planar(0.5, 0.0, 0.05))
    assert not expected.allows(Planar(0.12, 0.0, 0.4))


def test_an_inertial_heading_decides_between_places_that_look_alike() -> None:
    """After 2 s without a scan the body has turned by 20 degrees; 6 the other way would look the same."""
    scanner, turn = Scanner(ROUND_ROOM[:CORNERS]), 0.35
    random = np.random.default_rng(1)
    found = []
    for heading in (turn, None):
        odometer = LaserOdometer()
        for number in range(4):
            odometer.update(scanner.scan(Planar(), random), 0.1 * number, heading_rad=0.0 if heading else None)
        found.append(odometer.update(scanner.scan(Planar(0.0, 0.0, turn), random), 2.3, heading_rad=heading))
    assert found[0].is_valid
    assert found[0].alternatives == 0
    assert found[0].pose.yaw_rad == pytest.approx(turn, abs=0.01)
    assert found[1].covariance[2, 2] > (turn - found[1].pose.yaw_rad) ** 2, "without one, the doubt is told"
    assert found[1].alternatives > 0


@pytest.mark.parametrize("seed", [1, 2])
def test_between_pillars_that_look_alike_the_doubt_is_told_until_the_end_of_the_corridor_decides(seed: int) -> None:
    walls = [*pillars(-8, 8), ((13.0, -1.2), (13.0, 1.2))]
    scanner, random, odometer = Scanner(walls, range_max_m=6.0), np.random.default_rng(seed), LaserOdometer()
    speeds = [1.0] * 50 + [-1.0] * 50 + [1.0] * 20
    """Up and down; then, without scans for 1.6 s, it brakes: 1.6 m are expected, and 0.6 m or 2.6 m would look the same."""
    gap = len(speeds)
    way_m, speed = [0.0], 0.0
    for wanted in [*speeds, *[0.3] * 16, *[1.0] * 90]:
        speed += max(-0.15, min(wanted - speed, 0.15))
        way_m.append(way_m[-1] + 0.1 * speed)
    times_s = [0.1 * number for number in range(len(way_m))]
    del way_m[gap : gap + 15], times_s[gap : gap + 15]
    doubts, off = [], Planar()
    for number, (at_m, t_s) in enumerate(zip(way_m, times_s, strict=True)):
        motion = odometer.update(scanner.scan(Planar(at_m), random), t_s)
        if number < gap:
            continue
        assert motion.is_valid
        doubts.append(motion.alternatives)
        off = error_of(motion, Planar(at_m))
        if motion.reference_t_s < times_s[gap]:
            assert off.x_m**2 < 12.0 * motion.covariance[0, 0]
    assert doubts[0] > 0
    assert doubts[-1] == 0
    assert off.distance_m < 0.05


def test_after_it_was_covered_it_finds_itself_again_in_the_map_of_before() -> None:
    random, odometer, room = np.random.default_rng(1), LaserOdometer(), Scanner(HOLD)
    cover = Scanner(box(-0.7, -0.4, 1.1, 1.3))
    at_m, t_s = 0.0, 0.0
    for number in range(60):
        is_covered = 10 <= number < 25
        scan = cover.scan(Planar(0.0), random) if is_covered else room.scan(Planar(at_m), random)
        motion = odometer.update(scan, t_s)
        at_m, t_s = at_m + 0.05, t_s + 0.1
    assert motion.is_valid
    assert error_of(motion, Planar(at_m - 0.05)).distance_m < 0.03
