"""Laser logs: what is read from them, and where a damaged one is damaged."""

from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
from tests.data_folders import LASER_LOGS, OWN

from gloc3.errors import InputError, Refused
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import ranges_of
from gloc3_onboard.datasets.laser_log import LaserLog
from gloc3_onboard.datasets.laser_logs import read_laser_log

CARMEN = """# message formats defined
PARAM robot_width 0.54 1.0 host 1.0
ODOM 0.0 0.0 0.0 0 0 0 9.9 host 9.9
FLASER 4 1.0 nan 3.0 81.9 0.5 0.25 0.1 0.5 0.25 0.1 10.0 host 10.3
ODOM 1.5 0.25 0.1 0 0 0 10.4 host 10.4
FLASER 4 1.0 2.0 3.0 81.9 1.4 0.30 0.2 1.4 0.30 0.2 11.0 host 11.2
"""


def read(folder: Path, text: str, name: str = "a.log") -> LaserLog:
    (folder / name).write_text(text)
    return read_laser_log(folder / name)


def test_a_carmen_log_has_scans_with_the_first_of_their_times_and_the_motion_of_the_wheels(tmp_path: Path) -> None:
    log = read(tmp_path, CARMEN)
    first, second = log.scans
    assert log.times_s == [10.0, 11.0]
    assert first.pose == Planar(0.5, -0.25, -0.1)
    assert first.wheels is None
    assert second.wheels == pytest.approx(Planar(0.5, -0.25, -0.1).inverse() @ Planar(1.5, -0.25, -0.1))
    np.testing.assert_allclose(ranges_of(first.scan), [1.0, np.nan, 3.0, 81.9], rtol=1e-6)
    assert (first.scan.angle_min_rad, first.scan.angle_step_rad) == (-pi / 2.0, pi / 4.0)
    assert first.scan.range_max_m < 81.9


def test_an_odd_number_of_beams_has_both_ends(tmp_path: Path) -> None:
    log = read(tmp_path, "FLASER 5 1 1 1 1 1 0 0 0 0 0 0 1.0 h 1.0\n")
    assert log.scans[0].scan.angle_step_rad == pytest.approx(pi / 4.0)


def test_a_robot_laser_line_brings_its_own_angles(tmp_path: Path) -> None:
    line = "ROBOTLASER1 0 -1.2 2.4 0.8 25.0 0.01 0 4 1 2 3 4 2 7 8 0.5 0.1 0.2 0.4 0.1 0.2 0 0 0 0 0 12.5 host 12.6\n"
    found = read(tmp_path, line).scans[0]
    assert (found.scan.angle_min_rad, found.scan.angle_step_rad, found.scan.range_max_m) == (-1.2, 0.8, 25.0)
    assert (found.stamp_s, found.pose) == (12.5, Planar(0.5, -0.1, -0.2))


def test_a_gmapping_log_has_the_motion_of_the_wheels(tmp_path: Path) -> None:
    text = "ODOM 1 2 3 4\nLASER_READING 3 1 2 3 1.0 0 0 5.0\nSM_UPDATE 1 2 3\nLASER_READING 3 1 2 3 1.5 0 0.1 6.0\n"
    log = read(tmp_path, text, "a.gfs")
    assert log.times_s == [5.0, 6.0]
    assert log.scans[1].wheels == pytest.approx(Planar(0.5, 0.0, -0.1))


def test_a_breezy_log_is_in_millimetres_and_ticks(tmp_path: Path) -> None:
    def line(time_us: int, left: int, right: int) -> str:
        return " ".join(map(str, (time_us, 0, left, right, *[0] * 20, *[0, *[1500] * 681])))

    log = read(tmp_path, f"{line(1_000_000, 0, 0)}\n{line(1_100_000, 2000, 2000)}\n", "a.dat")
    scan = log.scans[0].scan
    assert log.times_s == [1.0, 1.1]
    assert ranges_of(scan)[1] == 1.5
    assert ranges_of(scan)[0] > scan.range_max_m
    assert scan.angle_min_rad == pytest.approx(-radians(120.0))
    assert log.scans[1].wheels == pytest.approx(Planar(2.0 * pi * 0.077))


def test_times_of_which_a_few_are_out_of_order_are_sorted(tmp_path: Path) -> None:
    line = next(line for line in CARMEN.splitlines() if line.startswith("FLASER"))
    head, _, tail = line.partition(" 10.0 host")
    assert tail, line

    def read_with(*stamps: float) -> LaserLog:
        return read(tmp_path, "\n".join(f"{head} {stamp} host{tail}" for stamp in stamps) + "\n")

    log = read_with(10.0, 10.2, 10.4, 10.7, 10.55, 10.8, 10.9, 11.1, 11.3, 11.5, 11.7)
    assert log.has_times
    assert log.jitter_s == pytest.approx(0.15)
    assert log.times_s[:6] == pytest.approx([10.0, 10.2, 10.4, 10.55, 10.7, 10.8])
    assert (np.diff(log.times_s) > 0.0).all()
    assert not read_with(10.0, 10.2, 10.4, 11.7, 10.6, 10.8, 11.0, 11.2).has_times, "by more than a usual step"


def test_times_that_do_not_grow_are_replaced_by_counting(tmp_path: Path) -> None:
    log = read(tmp_path, CARMEN.replace(" 11.0 host", " 10.0 host"))
    assert not log.has_times
    assert log.times_s == [0.0, 1.0]


@pytest.mark.parametrize(
    ("name", "text", "place"),
    [
        ("a.log", "FLASER x 1 2\n", "a.log:1:8: the number of readings"),
        ("a.log", "\nFLASER 3 1 2\n", "a.log:2:13: the line ends after 4 words; 5 are expected"),
        ("a.log", "FLASER 3 1 two 3 0 0 0 0 0 0 1 h 1\n", "a.log:1:12: 'two' is not a number"),
        ("a.log", "FLASER 3 1 2 3 0 0 nan 0 0 0 1 h 1\n", "a.log:1:20: this number is not finite"),
        ("a.log", "ODOM 1 2\n", "a.log:1:9: the line ends"),
        ("a.gfs", "LASER_READING 1 2 3 4\n", "a.gfs:1:22: the line ends"),
        ("a.dat", "1 2 3\n", "a.dat:1:6: the line ends after 3 words; 706 are expected"),
        ("a.log", "", "a.log: there is no laser scan in it"),
    ],
)
def test_a_damaged_log_is_told_with_its_place(tmp_path: Path, name: str, text: str, place: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, name)
    assert str(caught.value).startswith(place)


def test_what_is_not_text_or_not_there_or_unclear_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_bytes(b"\xff\xfe\x00FLASER")
    with pytest.raises(InputError, match="not text"):
        read_laser_log(tmp_path / "a.log")
    with pytest.raises(Refused, match="no file"):
        read_laser_log(tmp_path / "b.log")
    (tmp_path / "b.log").write_text("")
    with pytest.raises(Refused, match=r"name one of a\.log, b\.log"):
        read_laser_log(tmp_path)
    (tmp_path / "c.pdf").write_text("")
    with pytest.raises(Refused, match="of a known kind"):
        read_laser_log(tmp_path / "c.pdf")
    (tmp_path / "empty").mkdir()
    with pytest.raises(Refused, match="there is no laser log"):
        read_laser_log(tmp_path / "empty")


def test_a_log_of_our_own_is_read_whole_with_wheels_that_drift() -> None:
    log = read_laser_log(OWN / "laser" / "hold.log")
    assert len(log.scans) == 90
    assert all(scan.scan.angle_step_rad == pytest.approx(radians(1.0)) for scan in log.scans)
    assert log.scans[0].pose == Planar()
    steps = [(scan.wheels, scan.pose) for scan in log.scans if scan.wheels is not None and scan.pose is not None]
    assert len(steps) == 89
    assert sum(wheels.distance_m for wheels, _ in steps) > steps[-1][1].distance_m


@pytest.mark.outside
@pytest.mark.thorough
def test_real_logs_are_read_whole() -> None:
    counts = {name: len(read_laser_log(LASER_LOGS / name).scans) for name in ("csail", "aces", "breezy", "mbicp")}
    assert counts == {"csail": 406, "aces": 440, "breezy": 756, "mbicp": 778}
