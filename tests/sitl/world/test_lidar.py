"""The simulated 3D scanner: ranges worked out by hand, the vehicle's motion during a turn, and how a cloud is freed of it."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix
from gloc3.messages.frames import IDENTITY, rotate, rotate_back
from gloc3.messages.perception import PointCloud
from gloc3_onboard.algorithms.scan_matching.scan_points import Tilt, Twist, level_points
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.laser import LidarModel, LidarScanner
from gloc3_sitl.world.placing import Placing

TruthAt = Callable[..., Truth]
CLEAN = LidarModel(noise_m=0.0, drop_out=0.0)
HOLD = World.load("hold")
PLAIN = World(msgspec.structs.replace(HOLD.file, boxes={}, marker=None))
PLACING = Placing(PLAIN)


def points(cloud: PointCloud) -> NDArray[np.float64]:
    return np.frombuffer(cloud.data, "<f4").reshape(-1, 3).astype(float)


def test_walls_and_floor_are_where_they_are(truth_at: TruthAt) -> None:
    """The wall is at x = 21; straight ahead is the middle of a turn, after half its time."""
    cloud = LidarScanner(PLAIN, CLEAN).turn(truth_at(PLAIN, (9.0, 4.0, 1.5)))
    seen, ages_s = points(cloud), np.frombuffer(cloud.ages_s, "<f4")
    is_ahead = np.abs(np.arctan2(seen[:, 1], seen[:, 0])) < 0.01
    is_low = seen[:, 2] > 1.5
    assert seen[is_ahead & ~is_low, 0] == pytest.approx(12.0, abs=1e-3)
    assert np.quantile(seen[:, 2], (0.9, 1.0)) == pytest.approx(1.5 + 0.0973, abs=1e-3), "the floor is level"
    assert ages_s[is_ahead] == pytest.approx(89 / 180 * 0.1, abs=1e-5)
    assert (ages_s.min(), ages_s.max()) == (0.0, pytest.approx(0.1 * 179 / 180))


def test_noise_and_drop_outs_are_as_stated_and_the_same_moment_gives_the_same_turn(truth_at: TruthAt) -> None:
    model = LidarModel(noise_m=0.02, drop_out=0.1)
    truth = truth_at(PLAIN, (9.0, 4.0, 4.0))
    whole = points(LidarScanner(PLAIN, CLEAN).turn(truth))
    found = [LidarScanner(PLAIN, model, seed=3).turn(msgspec.structs.replace(truth, t_s=0.1 * n)) for n in range(10)]
    assert np.mean([len(points(cloud)) for cloud in found]) == pytest.approx(0.9 * len(whole), rel=0.01)
    ahead = np.concatenate([each[np.abs(np.arctan2(each[:, 1], each[:, 0])) < 0.01, 0] for each in map(points, found)])
    assert ahead[ahead > 11.0].std() == pytest.approx(0.02, rel=0.3)
    assert found[3] == LidarScanner(PLAIN, model, seed=3).turn(msgspec.structs.replace(truth, t_s=0.3))
    assert found[3] != LidarScanner(PLAIN, model, seed=4).turn(msgspec.structs.replace(truth, t_s=0.3))


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (3.0, -1.0, 0.5)])
@pytest.mark.parametrize("rate", [(0.0, 0.0, 0.0), (0.2, -0.3, 1.5)])
def test_the_motion_of_a_turn_is_taken_out_of_its_cloud(
    velocity: tuple[float, float, float], rate: tuple[float, float, float], truth_at: TruthAt
) -> None:
    """Judged by a ray from the end of the turn to each point: it ends there, but where an edge hides the point."""
    still = truth_at(PLAIN, (9.0, 4.0, 2.0), (0.1, -0.05, 0.7))
    velocity_ned = rotate(still.attitude_wxyz, velocity)
    moving = msgspec.structs.replace(still, velocity_ned_m_s=velocity_ned, rate_frd_rad_s=rate)
    cloud = LidarScanner(PLAIN, CLEAN).turn(moving)
    twist = Twist(rotate_back(still.attitude_wxyz, velocity_ned), rate)

    def errors_m(seen: NDArray[np.float64]) -> NDArray[np.float64]:
        place = PLACING.body(still).mounted(CLEAN.position_frd_m, IDENTITY)
        rays = seen - np.array(CLEAN.position_frd_m)
        away_m = np.linalg.norm(rays, axis=1)
        directions = (rays / away_m[:, None]) @ matrix(place.local_from_here).T
        ranges = PLAIN.geometry.ranges(np.array(place.position_m), directions, still.t_s)
        return np.asarray(np.abs(ranges - away_m))

    assert np.median(errors_m(level_points(cloud, Tilt(), twist).points_m)) < 2e-3
    assert np.quantile(errors_m(level_points(cloud, Tilt(), twist).points_m), 0.95) < 0.02
    skewed = np.quantile(errors_m(points(cloud)), 0.75)
    assert skewed > 0.05 if twist != Twist() else skewed < 1e-3


def test_the_vehicles_scanner_is_a_reduced_vlp_16() -> None:
    assert np.degrees(rig.LIDAR.elevations_rad) == pytest.approx(np.arange(-15, 16, 2))
    assert 1.0 / rig.LIDAR.rate_hz == pytest.approx(0.1)
