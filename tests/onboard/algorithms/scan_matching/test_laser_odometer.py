"""The laser odometer: how exact it is, what it says of what it cannot know, and what it makes of bad scans."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from math import inf, nan, pi

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.onboard.algorithms.scan_matching.rays import CORRIDOR, HOLD, Scanner, Wall, box, flight

from gloc3.messages.frames import wrap_pi
from gloc3.messages.perception import UNKNOWN_VARIANCE, LaserScan
from gloc3_onboard.algorithms.scan_matching.laser_odometer import (
    MOST_FAILURES,
    LaserMotion,
    LaserOdometer,
    LaserOdometerSettings,
)
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt

Flown = list[tuple[LaserMotion, Planar]]


def fly(scanner: Scanner, way: Iterator[tuple[float, Planar, Tilt]], *, seed: int = 1) -> Flown:
    random, odometer = np.random.default_rng(seed), LaserOdometer()
    return [(odometer.update(scanner.scan(pose, random, tilt), t_s, tilt), pose) for t_s, pose, tilt in way]


def errors(flown: Flown) -> list[tuple[LaserMotion, np.ndarray[tuple[int], np.dtype[np.float64]]]]:
    """Of each valid motion, against the true motion since its reference."""
    true = {motion.t_s: pose for motion, pose in flown}
    found = []
    for motion, pose in flown:
        if motion.is_valid:
            real = true[motion.reference_t_s].inverse() @ pose
            off = np.subtract(motion.motion, real)
            found.append((motion, np.array((off[0], off[1], wrap_pi(float(off[2]))))))
    return found


def straight(speed_m_s: float = 0.8, steps: int = 30) -> Iterator[tuple[float, Planar, Tilt]]:
    for number in range(steps):
        yield 0.1 * number, Planar(0.1 * speed_m_s * number), Tilt()


def test_a_flight_in_the_hold_drifts_by_less_than_a_part_in_a_thousand() -> None:
    flown = fly(Scanner(HOLD), flight(12.0))
    begin, end = flown[0][1], flown[-1]
    error = (begin.inverse() @ end[1]).inverse() @ (flown[0][0].pose.inverse() @ end[0].pose)
    assert all(motion.is_valid for motion, _ in flown[1:])
    assert not any(motion.is_degenerate for motion, _ in flown)
    assert error.distance_m < 0.012
    assert abs(error.yaw_rad) < 0.002


def test_its_covariance_is_honest() -> None:
    squares = [off @ np.linalg.solve(motion.covariance, off) for motion, off in errors(fly(Scanner(HOLD), flight(8.0)))]
    assert 0.2 < float(np.mean(squares)) < 4.0  # three degrees of freedom
    assert float(np.percentile(squares, 95)) < 7.8


def test_along_a_corridor_nothing_is_known_and_across_it_much() -> None:
    flown = fly(Scanner(CORRIDOR), straight())
    for motion, _ in flown[1:]:
        assert motion.is_valid
        assert motion.is_degenerate
        assert motion.covariance[0, 0] > 0.9 * UNKNOWN_VARIANCE
        assert np.linalg.eigvalsh(motion.covariance[:2, :2])[0] < 1e-4
        assert motion.covariance[1, 1] < 0.1 * motion.covariance[0, 0]
        assert motion.covariance[2, 2] < 1e-5
    assert abs(flown[-1][0].motion.y_m) < 0.01


def test_along_a_corridor_the_wheels_tell_that_the_body_stops() -> None:
    """At ten scans a second: the odometer alone goes on as before, for all that it can see."""
    random, scanner, odometer, before = np.random.default_rng(1), Scanner(CORRIDOR), LaserOdometer(), Planar()
    for number in range(60):
        pose = Planar(0.08 * min(number, 20))
        found = odometer.update(scanner.scan(pose, random), 0.1 * number, guess=before.inverse() @ pose)
        before = pose
    assert found.is_degenerate
    assert found.pose.x_m == pytest.approx(1.6, abs=0.2)


def test_a_corridor_with_an_end_in_sight_is_known_along_itself_too_but_less() -> None:
    end = [((9.0, -1.2), (9.0, -0.8)), ((8.0, 1.2), (8.0, 1.0))]
    flown = fly(Scanner([*CORRIDOR, *end], range_max_m=12.0), straight(steps=15))
    for motion, off in errors(flown):
        assert motion.covariance[0, 0] > 10.0 * motion.covariance[1, 1]
        assert motion.is_degenerate or off[0] ** 2 < 9.0 * motion.covariance[0, 0]


def test_the_hold_is_degenerate_for_a_short_sighted_scanner_and_it_says_so() -> None:
    flown = fly(Scanner(HOLD, range_max_m=5.6), flight(14.0))
    assert sum(motion.is_degenerate for motion, _ in flown) > 20
    for motion, off in errors(flown):
        assert off @ np.linalg.solve(motion.covariance, off) < 25.0


def test_a_round_room_tells_no_heading() -> None:
    ring = [(8.0 * np.cos(a), 8.0 * np.sin(a)) for a in np.linspace(0.0, 2.0 * pi, 721)]
    flown = fly(Scanner(list(pairwise(ring))), straight(0.2, 6))
    for motion, _ in flown[1:]:
        assert motion.is_degenerate
        assert motion.covariance[2, 2] == pytest.approx(UNKNOWN_VARIANCE)
        assert motion.covariance[0, 0] < 1e-3


def test_the_floor_is_not_taken_for_a_wall_when_the_body_tilts() -> None:
    scanner, random = Scanner(HOLD), np.random.default_rng(1)
    tilt = Tilt(0.0, -0.25, 1.2)
    level = LaserOdometer()
    level.update(scanner.scan(Planar(), random, Tilt(0.0, 0.0, 1.2)), 0.0, Tilt(0.0, 0.0, 1.2))
    motion = level.update(scanner.scan(Planar(0.1), random, tilt), 0.1, tilt)
    assert motion.is_valid
    assert motion.quality > 0.9
    assert motion.motion.x_m == pytest.approx(0.1, abs=0.01)


def test_a_scan_that_took_time_is_straightened_by_the_motion() -> None:
    scanner, random, odometer = Scanner(HOLD), np.random.default_rng(1), LaserOdometer()
    motion = LaserMotion(t_s=0.0, reference_t_s=0.0, motion=Planar(), covariance=np.eye(3), pose=Planar())
    for number in range(12):
        poses = [Planar(0.2 * (number + share), 0.0, 0.0) for share in np.linspace(-1.0, 0.0, 8)]
        parts = [scanner.scan(pose, random) for pose in poses]
        ranges = np.concatenate(
            [np.frombuffer(part.ranges_m, "<f4").reshape(8, -1)[index] for index, part in enumerate(parts)]
        )
        scan = msgspec.structs.replace(parts[0], ranges_m=ranges.tobytes(), duration_s=0.1)
        motion = odometer.update(scan, 0.1 * number)
    assert motion.pose.x_m == pytest.approx(2.2, abs=0.03)
    assert motion.quality > 0.8


def test_a_scanner_that_looks_aside_tells_the_motion_of_the_body() -> None:
    random = np.random.default_rng(1)
    scanner, odometer = Scanner(HOLD), LaserOdometer(mount=Mount((0.2, 0.0, 0.0), pi / 2.0))
    body = [Planar(0.05 * number, 0.0, 0.03 * number) for number in range(8)]
    for number, pose in enumerate(body):
        motion = odometer.update(scanner.scan(pose @ Planar(0.2, 0.0, pi / 2.0), random), 0.1 * number)
    assert motion.pose == pytest.approx(body[-1], abs=0.01)


def test_a_motion_that_somebody_knows_helps_over_a_gap() -> None:
    random, scanner = np.random.default_rng(1), Scanner(HOLD, angle_min_rad=-pi / 2.0, angle_span_rad=pi)
    odometer = LaserOdometer()
    odometer.update(scanner.scan(Planar(), random), 0.0)
    step = Planar(1.5, 0.3, 0.7)
    motion = odometer.update(scanner.scan(step, random), 3.0, guess=Planar(1.4, 0.4, 0.6))
    assert motion.pose == pytest.approx(step, abs=0.02)


def _filled(scan: LaserScan, value: float) -> LaserScan:
    return msgspec.structs.replace(scan, ranges_m=np.full(360, value, "<f4").tobytes())


def test_a_maximum_that_32_bits_round_down_is_no_wall() -> None:
    scanner, random, odometer = Scanner(CORRIDOR, range_max_m=5.6), np.random.default_rng(1), LaserOdometer()
    ranges = np.frombuffer(scanner.scan(Planar(), random).ranges_m, "<f4")
    assert np.count_nonzero(ranges == np.float32(5.6)) > 10
    for number in range(10):
        motion = odometer.update(scanner.scan(Planar(0.1 * number), random), 0.1 * number)
    assert motion.is_degenerate


BAD: dict[str, tuple[Callable[[LaserScan], LaserScan], str]] = {
    "not a number": (lambda scan: _filled(scan, nan), "no range of the scan is a number"),
    "all zero": (lambda scan: _filled(scan, 0.0), "all ranges of the scan are zero"),
    "all at the maximum": (lambda scan: _filled(scan, scan.range_max_m), "nothing is in reach of the scanner"),
    "all infinite": (lambda scan: _filled(scan, inf), "no range of the scan is a number"),
    "cut off": (lambda scan: msgspec.structs.replace(scan, ranges_m=scan.ranges_m[:50]), "50 bytes"),
    "without angles": (lambda scan: msgspec.structs.replace(scan, angle_step_rad=nan), "where its beams look"),
    "invalid already": (lambda scan: msgspec.structs.replace(scan, is_valid=False, reason="dark"), "dark"),
    "of elsewhere": (lambda scan: Scanner(box(-0.7, -0.4, 1.1, 1.3)).scan(Planar(), np.random.default_rng(1)), "fits"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_scan_has_a_reason_and_the_next_good_one_is_valid_again(name: str) -> None:
    corrupt, reason = BAD[name]
    random, scanner, odometer = np.random.default_rng(1), Scanner(HOLD), LaserOdometer()
    for number in range(4):
        odometer.update(scanner.scan(Planar(0.05 * number), random), 0.1 * number)
    motion = odometer.update(corrupt(scanner.scan(Planar(0.2), random)), 0.4)
    assert not motion.is_valid
    assert reason in motion.reason
    assert motion.quality == 0.0
    assert np.isfinite([*motion.motion, *motion.covariance.ravel()]).all()
    motion = odometer.update(scanner.scan(Planar(0.25), random), 0.5)
    assert motion.is_valid
    assert motion.pose.x_m == pytest.approx(0.25, abs=0.01)


def test_a_scan_that_comes_again_or_too_late_is_not_taken() -> None:
    random, scanner, odometer = np.random.default_rng(1), Scanner(HOLD), LaserOdometer()
    for number in range(3):
        scan = scanner.scan(Planar(0.05 * number), random)
        odometer.update(scan, 0.1 * number)
    assert "beam for beam" in odometer.update(scan, 0.3).reason
    assert "not newer" in odometer.update(scanner.scan(Planar(), random), 0.1).reason
    assert odometer.update(scanner.scan(Planar(0.15), random), 0.4).is_valid


@pytest.mark.parametrize("key_share", [0.7, 1.0], ids=["few references", "a reference each scan"])
@pytest.mark.parametrize("climb_m_s", [0.15, -0.8])
def test_beside_a_wall_that_leans_a_climb_is_doubted_however_it_is_cut_up(key_share: float, climb_m_s: float) -> None:
    """The only wall across recedes by 0.7 m of each metre climbed: that looks like motion."""
    random, odometer = np.random.default_rng(1), LaserOdometer(LaserOdometerSettings(key_share=key_share))
    claimed_m, moved_m, last = 0.0, 0.0, None
    steps = round(1.2 / abs(climb_m_s) / 0.1)
    for number in range(steps + 1):
        height_m = 2.0 + climb_m_s * 0.1 * number
        across: Wall = ((2.0 + 0.7 * height_m, -30.0), (2.0 + 0.7 * height_m, 2.0))
        scanner = Scanner([across, ((-30.0, 2.0), (2.0 + 0.7 * height_m, 2.0))], range_max_m=12.0)
        motion = odometer.update(scanner.scan(Planar(), random), 0.1 * number, Tilt(height_m=height_m))
        if last is not None and motion.reference_t_s != last.reference_t_s:
            claimed_m += float(np.sqrt(last.covariance[0, 0]))
            moved_m += last.motion.x_m
        last = motion if motion.is_valid else last
    assert last is not None
    claimed_m, moved_m = claimed_m + float(np.sqrt(last.covariance[0, 0])), moved_m + last.motion.x_m
    assert abs(moved_m) > 0.4, "the wall that leans has been taken for motion"
    assert claimed_m > abs(moved_m)


def test_after_a_clock_was_set_back_it_begins_anew() -> None:
    random, scanner, odometer = np.random.default_rng(1), Scanner(HOLD), LaserOdometer()
    for number in range(3):
        odometer.update(scanner.scan(Planar(0.05 * number), random), 100.0 + 0.1 * number)
    text = [odometer.update(scanner.scan(Planar(), random), 0.1 * number) for number in range(MOST_FAILURES + 4)]
    assert [motion.is_valid for motion in text].index(True) <= MOST_FAILURES + 2
    assert text[-1].is_valid
    assert text[-1].reference_t_s < 1.0


def test_somewhere_else_it_gives_up_and_begins_anew() -> None:
    random, odometer = np.random.default_rng(1), LaserOdometer()
    odometer.update(Scanner(HOLD).scan(Planar(), random), 0.0)
    other = Scanner(box(-0.7, -0.4, 1.1, 1.3))
    text = [odometer.update(other.scan(Planar(), random), 0.1 * number) for number in range(1, MOST_FAILURES + 5)]
    assert any(motion.reason.endswith("it restarts") for motion in text)
    assert text[-1].is_valid
    assert text[-1].reference_t_s > 0.0


@pytest.mark.thorough
@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.floats(-1.0, 60.0, width=32) | st.just(nan) | st.just(inf), st.integers(0, 360)), max_size=12
    ),
    st.floats(-1.0, 3.0),
)
def test_whatever_a_scan_holds_the_pose_is_a_number(spoilt: list[tuple[float, int]], gap_s: float) -> None:
    random, scanner, odometer = np.random.default_rng(1), Scanner(HOLD), LaserOdometer()
    odometer.update(scanner.scan(Planar(), random), 0.0)
    odometer.update(scanner.scan(Planar(0.05), random), 0.1)
    scan = scanner.scan(Planar(0.1), random)
    ranges = np.frombuffer(scan.ranges_m, "<f4").copy()
    for value, begin in spoilt:
        ranges[begin : begin + 60] = value
    for t_s in (0.1 + gap_s, 3.5, 3.6):
        motion = odometer.update(msgspec.structs.replace(scan, ranges_m=ranges.tobytes()), t_s)
        assert np.isfinite([*motion.motion, *motion.pose, *motion.covariance.ravel()]).all()
        assert np.linalg.eigvalsh(motion.covariance).min() > 0.0
