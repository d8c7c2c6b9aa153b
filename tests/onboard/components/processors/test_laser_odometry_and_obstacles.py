"""The components around the laser odometer and the obstacles."""

from math import inf, pi, sin
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner, box
from tests.onboard.messages import at, autopilot_pose, pose

from gloc3.component.ports import PortReport, inbox_of
from gloc3.messages.frames import from_euler
from gloc3.messages.perception import UNKNOWN_VARIANCE, Odometry
from gloc3.messages.vehicle import NOT_MEASURED_M, OBSTACLE_SECTORS, HeightAboveGround, ObstacleScan
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserMotion
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Tilt
from gloc3_onboard.components.processors.laser_odometry import (
    LaserOdometryProcessor,
    LaserOdometrySettings,
    odometry_of,
)
from gloc3_onboard.components.processors.obstacles import ObstacleProcessor, ObstacleSettings

SCANNER = Scanner(HOLD)


def message(result: Any) -> Any:
    return result.message if isinstance(result, PortReport) else result


def odometry(component: LaserOdometryProcessor, t_s: float, **given: Any) -> Odometry:
    found = message(component.work(t_s, inbox_of(**given))[0])
    assert isinstance(found, Odometry)
    return found


@pytest.mark.parametrize("topic", ["autopilot_pose", "autopilot_attitude"], ids=["with a position", "without one"])
def test_scans_and_attitudes_become_odometry_in_the_plane(topic: str) -> None:
    component, random = LaserOdometryProcessor(), np.random.default_rng(1)
    component.initialize(LaserOdometrySettings())
    component.start()
    for number in range(6):
        t_s, tilt = 0.1 * number, Tilt(0.02 * number, -0.03 * number, 1.5)
        where = Planar(0.06 * number, 0.0, 0.02 * number)
        attitude = from_euler(tilt.roll_rad, tilt.pitch_rad, where.yaw_rad)
        found = odometry(
            component,
            t_s,
            laser=at(t_s, SCANNER.scan(where, random, tilt)),
            height=at(t_s, HeightAboveGround(height_m=1.5, is_valid=True)),
            **{topic: at(t_s, autopilot_pose(ned_from_frd=attitude))},
        )
    assert found.is_valid
    assert found.is_level
    assert found.reference_t_s == 0.0
    assert found.position_m == pytest.approx((0.3, 0.0, 0.0), abs=0.01)
    assert found.reference_from_frd == pytest.approx(from_euler(0.1, -0.15, 0.1), abs=0.003)
    variances = np.diag(np.reshape(found.covariance, (6, 6)))
    assert list(variances[2:5]) == [UNKNOWN_VARIANCE] * 3
    assert variances[[0, 1, 5]].max() < 1e-3
    assert (component.scans, component.refused, component.degenerate) == (6, 1, 0)


def test_the_heading_of_a_body_that_leans_is_less_certain_by_what_its_roll_and_pitch_may_be_off() -> None:
    found = LaserMotion(t_s=1.0, reference_t_s=0.0, motion=Planar(), covariance=np.eye(3) * 1e-6, pose=Planar())
    level, leaning = (odometry_of(found, roll, -roll).covariance[35] for roll in (0.0, 0.1))
    assert level == pytest.approx(1e-6)
    assert leaning == pytest.approx(1e-6 + 2.0 * (0.005 * sin(0.1)) ** 2)


def test_without_an_attitude_or_a_scan_it_says_so_and_goes_on_afterwards() -> None:
    component, random = LaserOdometryProcessor(), np.random.default_rng(1)
    component.initialize(LaserOdometrySettings())
    component.start()
    scan = at(0.0, SCANNER.scan(Planar(), random))
    assert "no attitude" in odometry(component, 0.0, laser=scan).reason
    assert component.work(0.9, inbox_of()) == []
    assert odometry(component, 1.1, laser=[], autopilot_pose=[]).reason == "no scan received"
    for t_s in (1.2, 1.3):
        given = {"laser": at(t_s, SCANNER.scan(Planar(), random)), "autopilot_pose": at(t_s, autopilot_pose())}
        found = odometry(component, t_s, **given)
    assert found.is_valid


def test_who_no_longer_hears_a_height_goes_on_from_the_last_one_by_how_far_it_has_come_down() -> None:
    component, random = LaserOdometryProcessor(), np.random.default_rng(1)
    component.initialize(LaserOdometrySettings())
    component.start()
    reasons = []
    for t_s, height_m in ((0.0, 1.5), (0.1, 1.5), (20.0, 1.5), (20.1, 0.1)):
        given: dict[str, Any] = {"laser": at(t_s, SCANNER.scan(Planar(), random))}
        given["autopilot_pose"] = at(t_s, autopilot_pose(height=height_m + 3.0))
        if t_s < 1.0:
            given["height"] = at(t_s, HeightAboveGround(height_m=height_m, is_valid=True))
        reasons.append("above the floor" in odometry(component, t_s, **given).reason)
    assert reasons == [False, False, False, True]


def obstacles(component: ObstacleProcessor, t_s: float, **given: Any) -> ObstacleScan:
    found = message(component.work(t_s, inbox_of(**given))[0])
    assert isinstance(found, ObstacleScan)
    return found


def test_what_a_scan_hits_is_placed_in_the_frame_of_the_pose() -> None:
    component, random = ObstacleProcessor(), np.random.default_rng(1)
    component.initialize(ObstacleSettings())
    scanner = Scanner([*box(-3.0, -13.0, 24.0, 16.0), *box(6.0, -9.0, 1.5, 1.0)], noise_m=0.0)
    where, tilt = Planar(3.0, -8.5, pi / 2.0), Tilt(0.0, -0.05, 1.5)
    found = obstacles(
        component,
        5.0,
        laser=at(5.0, scanner.scan(where, random, tilt)),
        pose=at(4.95, pose(3.0, -8.5, 1.5, ned_from_frd=from_euler(0.0, -0.05, pi / 2.0))),
        height=at(4.9, HeightAboveGround(height_m=1.5, is_valid=True)),
    )
    assert found.is_valid
    assert found.height_m == pytest.approx(1.5)
    assert len(found.sectors_m) == OBSTACLE_SECTORS
    assert found.sectors_m[OBSTACLE_SECTORS * 3 // 4] == pytest.approx(3.0, abs=0.02)  # the box, left of the body
    assert found.sectors_m[0] == pytest.approx(11.5, abs=0.1)
    assert found.closest_ne_m[0] == pytest.approx((6.0, -8.5), abs=0.1)
    assert component.closest_m == pytest.approx(3.0, abs=0.02)
    places = np.array(found.points_ne_m)
    assert 100 < len(places) <= 180
    is_box = (np.abs(places[:, 0] - 6.0) < 0.02) & (np.abs(places[:, 1] + 8.5) < 0.55)
    is_wall = (np.abs(places - (-3.0, -13.0)) < 0.05).any(axis=1) | (np.abs(places - (21.0, 3.0)) < 0.05).any(axis=1)
    assert np.count_nonzero(is_box) >= 5
    assert np.count_nonzero(is_box | is_wall) > 0.95 * len(places)  # no floor


def test_nothing_in_sight_is_valid_and_what_was_not_looked_at_is_told() -> None:
    component, random = ObstacleProcessor(), np.random.default_rng(1)
    component.initialize(ObstacleSettings())
    half = Scanner(box(100.0, 100.0, 1.0, 1.0), angle_min_rad=-pi / 2.0, angle_span_rad=pi)
    found = obstacles(component, 1.0, laser=at(1.0, half.scan(Planar(), random)), pose=at(1.0, pose()))
    assert found.is_valid
    assert found.points_ne_m == found.closest_ne_m == []
    assert found.sectors_m[0] == found.range_max_m
    assert found.sectors_m[OBSTACLE_SECTORS // 2] == NOT_MEASURED_M
    assert component.closest_m < inf


def test_a_bad_scan_or_no_pose_is_not_valid() -> None:
    component, random = ObstacleProcessor(), np.random.default_rng(1)
    component.initialize(ObstacleSettings())
    scan = SCANNER.scan(Planar(), random)
    bad = replace(scan, is_valid=False, reason="torn")
    assert obstacles(component, 1.0, laser=at(1.0, bad), pose=at(1.0, pose())).reason == "torn"
    assert "no valid pose" in obstacles(component, 2.0, laser=at(2.0, scan), pose=at(1.0, pose())).reason
    lost = at(3.0, replace(pose(), is_valid=False))
    assert not obstacles(component, 3.0, laser=at(3.0, scan), pose=lost).is_valid
    assert component.refused == 3
