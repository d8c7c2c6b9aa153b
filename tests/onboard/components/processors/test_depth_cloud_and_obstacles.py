"""From a depth picture to points on the body, and from points to obstacles: floor, height, noise, memory, bad data."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.camera.model import CameraModel
from gloc3.messages.frames import Vector3, from_euler
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, DepthImage, OccupancyMap, PointCloud
from gloc3.messages.vehicle import NOT_MEASURED_M, HeightAboveGround, ObstacleScan
from gloc3_onboard.components.processors.cloud_obstacles import CloudObstacleProcessor, CloudObstacleSettings
from gloc3_onboard.components.processors.depth_cloud import DepthCloudProcessor, DepthCloudSettings
from gloc3_onboard.components.processors.map import MapProcessor

MODEL = CameraModel(
    width=64, height=48, focal_px=(32.0, 32.0), center_px=(31.5, 23.5), position_frd_m=(0.1, 0.0, -0.02)
)
Floats = NDArray[np.float64]


class OneRig:
    """A rig whose every camera is the same."""

    def model(self, camera: str) -> CameraModel | None:
        return MODEL


def depth_of(away_m: Floats) -> DepthImage:
    data = np.rint(away_m / 0.001).astype("<u2").tobytes()
    return DepthImage(camera="depth", width=64, height=48, data=data, scale_m=0.001, range_min_m=0.3, range_max_m=10.0)


def cloud_of(*parts: Floats, origin: Vector3 = (0.0, 0.0, 0.0)) -> PointCloud:
    points = np.vstack(parts) if parts else np.zeros((0, 3))
    return PointCloud(sensor="depth", data=points.astype("<f4").tobytes(), origin_frd_m=origin, range_max_m=10.0)


def wall(ahead_m: float, left_m: float, right_m: float, top_m: float = -0.4, bottom_m: float = 0.4) -> Floats:
    """Points of an upright wall before the vehicle, on the body's axes."""
    across, down = np.meshgrid(np.arange(left_m, right_m, 0.04), np.arange(top_m, bottom_m, 0.04))
    return np.column_stack((np.full(across.size, ahead_m), across.ravel(), down.ravel()))


# --- pictures to points ---


def cloud_stage(**settings: Any) -> Stage:
    return Stage(DepthCloudProcessor(OneRig()), DepthCloudSettings(**settings))


def points(found: Any) -> Floats:
    return np.frombuffer(found.data, "<f4").reshape(-1, 3).astype(float)


def test_pixels_become_points_on_the_body_along_the_rays_of_the_camera() -> None:
    stage = cloud_stage(most_points=64 * 48)
    stage.step(depth=depth_of(np.full((48, 64), 4.0)))
    found = stage.last(PointCloud)
    seen = points(found)
    assert len(seen) == 64 * 48
    assert seen[:, 0] == pytest.approx(4.1)
    assert (seen[:, 1].min(), seen[:, 1].max()) == pytest.approx((-4.0 * 31.5 / 32, 4.0 * 31.5 / 32))
    assert (seen[:, 2].min(), seen[:, 2].max()) == pytest.approx((-0.02 - 4.0 * 23.5 / 32, -0.02 + 4.0 * 23.5 / 32))
    assert (found.origin_frd_m, found.range_max_m, found.sensor) == ((0.1, 0.0, -0.02), 10.0, "depth")


def test_what_is_not_measured_and_what_hangs_between_near_and_far_is_no_point() -> None:
    away_m = np.full((48, 64), 6.0)
    away_m[:, 32:] = 2.0
    away_m[:, 31] = 4.0  # between the two: a depth camera makes that up
    away_m[10, 10] = 0.2
    away_m[20, 20] = 12.0
    away_m[30, 30] = 0.0
    stage = cloud_stage(most_points=64 * 48)
    stage.step(depth=depth_of(away_m))
    ahead_m = points(stage.last(PointCloud))[:, 0] - 0.1
    assert set(np.round(ahead_m, 3)) == {2.0, 6.0}
    assert len(ahead_m) == 64 * 48 - 48 - 3


def test_a_large_picture_is_thinned_out() -> None:
    stage = cloud_stage(most_points=800)
    stage.step(depth=depth_of(np.full((48, 64), 4.0)))
    assert len(points(stage.last(PointCloud))) == 32 * 24


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"data": b"12"}, "torn: 2 bytes of a depth picture of 64 x 48"),
        ({"is_valid": False, "reason": "no light"}, "no light"),
        ({"width": 32, "height": 96}, "calibrate the camera as it is used"),
        ({"scale_m": 0.0}, "its unit of 0 m is impossible"),
        ({"range_max_m": 0.1}, "its ranges from 0.3 to 0.1 m are impossible"),
    ],
)
def test_a_picture_that_cannot_be_used_makes_a_cloud_that_says_why(wrong: dict[str, Any], why: str) -> None:
    stage = cloud_stage()
    stage.step(depth=replace(depth_of(np.full((48, 64), 4.0)), **wrong))
    found = stage.last(PointCloud)
    assert not found.is_valid
    assert why in found.reason


# --- points to obstacles ---


def obstacle_stage(**settings: Any) -> Stage:
    return Stage(CloudObstacleProcessor(), CloudObstacleSettings(**settings))


def seen(
    stage: Stage, cloud: PointCloud, at: Vector3 = (0.0, 0.0, 1.5), euler: Vector3 = (0.0, 0.0, 0.0)
) -> ObstacleScan:
    north, east, height_m = at
    place = pose(north, east, height_m, ned_from_frd=from_euler(*euler))
    stage.step(0.1, cloud=cloud, pose=place, height=HeightAboveGround(height_m=height_m, is_valid=True))
    found = stage.last(ObstacleScan)
    assert isinstance(found, ObstacleScan)
    return found


def test_a_wall_is_placed_in_the_frame_of_the_pose_with_its_sectors() -> None:
    found = seen(obstacle_stage(), cloud_of(wall(3.0, -1.0, 1.0)), (10.0, 5.0, 1.5), (0.0, 0.0, math.pi / 2))
    places = np.array(found.points_ne_m)
    assert places[:, 1] == pytest.approx(8.0, abs=0.1), "ahead is east"
    assert (places[:, 0].min(), places[:, 0].max()) == pytest.approx((9.0, 11.0), abs=0.1)
    assert found.sectors_m[0] == pytest.approx(3.0, abs=0.1)
    assert found.sectors_m[36] == NOT_MEASURED_M, "it cannot look behind"
    assert found.closest_ne_m[0] == pytest.approx((10.0, 8.0), abs=0.1)
    assert (found.is_valid, found.height_m) == (True, 1.5)


def test_the_floor_and_what_is_above_or_below_is_no_obstacle_also_in_a_tilted_body() -> None:
    pitch = -0.3
    north, east = np.meshgrid(np.arange(1.0, 8.0, 0.05), np.arange(-2.0, 2.0, 0.05))
    floor = np.column_stack((north.ravel(), east.ravel(), np.full(north.size, 0.7)))
    lamp = wall(3.0, -0.5, 0.5, -1.4, -0.8)
    level_from_frd = np.array(
        ((math.cos(pitch), 0, math.sin(pitch)), (0, 1, 0), (-math.sin(pitch), 0, math.cos(pitch)))
    )
    found = seen(
        obstacle_stage(), cloud_of(floor @ level_from_frd, lamp @ level_from_frd), (0.0, 0.0, 0.7), (0.0, pitch, 0.0)
    )
    assert (found.is_valid, found.points_ne_m) == (True, [])
    beam = wall(3.0, -0.5, 0.5, -0.3, 0.3) @ level_from_frd
    found = seen(obstacle_stage(), cloud_of(floor @ level_from_frd, beam), (0.0, 0.0, 0.7), (0.0, pitch, 0.0))
    assert np.array(found.points_ne_m)[:, 0] == pytest.approx(3.0, abs=0.1)


def test_single_points_are_noise() -> None:
    speck = np.array([[2.0, 0.0, 0.0], [2.01, 0.0, 0.0]])
    assert seen(obstacle_stage(), cloud_of(speck)).points_ne_m == []
    assert seen(obstacle_stage(fewest_points=2), cloud_of(speck)).points_ne_m != []


def test_what_leaves_the_view_is_kept_until_it_is_too_long_ago() -> None:
    stage = obstacle_stage(memory_s=2.0)
    seen(stage, cloud_of(wall(3.0, -1.0, 1.0)))
    turned = seen(stage, cloud_of(), euler=(0.0, 0.0, math.pi / 2))
    assert len(turned.points_ne_m) > 10
    assert turned.sectors_m[54] == pytest.approx(3.0, abs=0.1), "now it is left of the body"
    for _ in range(21):
        turned = seen(stage, cloud_of(), euler=(0.0, 0.0, math.pi / 2))
    assert turned.points_ne_m == []


def test_what_the_sensor_sees_through_is_gone_at_once_and_what_it_sees_over_is_not() -> None:
    stage = obstacle_stage()
    box = wall(3.0, -1.0, 1.0)
    assert seen(stage, cloud_of(box)).points_ne_m
    over = wall(7.0, -3.0, 3.0, -2.2, -1.4)  # such a ray is out of the band where the box is
    assert np.array(seen(stage, cloud_of(over)).points_ne_m)[:, 0] == pytest.approx(3.0, abs=0.1)
    found = seen(stage, cloud_of(wall(7.0, -3.0, 3.0)))
    assert np.array(found.points_ne_m)[:, 0] == pytest.approx(7.0, abs=0.1)


def test_a_jump_of_the_pose_clears_the_memory() -> None:
    stage = obstacle_stage()
    seen(stage, cloud_of(wall(3.0, -1.0, 1.0)))
    stage.step(0.1, cloud=cloud_of(), pose=replace(pose(height=1.5), reset_counter=1))
    assert stage.last(ObstacleScan).points_ne_m == []


def test_bad_clouds_and_poses_are_reported_with_their_reason() -> None:
    stage = obstacle_stage()
    for cloud, why in (
        (replace(cloud_of(), is_valid=False, reason="covered"), "covered"),
        (replace(cloud_of(), data=bytes(13)), "13 bytes are not points of 12 bytes"),
    ):
        found = seen(stage, cloud)
        assert (found.is_valid, found.reason) == (False, why)
    stage.step(0.1, cloud=cloud_of(), pose=replace(pose(), is_valid=False))
    assert "no valid pose" in stage.last(ObstacleScan).reason
    not_numbers = np.full((50, 3), np.nan)
    assert seen(stage, cloud_of(not_numbers, wall(2.0, -0.5, 0.5))).is_valid


# --- the map ---


def test_a_map_is_built_from_clouds_in_every_layer_that_they_show() -> None:
    stage = Stage(MapProcessor())
    for _ in range(4):
        walls = cloud_of(wall(4.0, -2.0, 2.0, -1.0, 1.0), wall(2.0, 0.5, 1.0, 0.6, 1.0))
        height = HeightAboveGround(height_m=2.25, is_valid=True)
        stage.step(1.1, cloud=walls, pose=pose(height=2.25), height=height)
    found = stage.last(OccupancyMap)
    assert isinstance(found, OccupancyMap)

    def state(level: int, north: float, east: float) -> int:
        row, column = (
            math.floor((at - first) / 0.1) for at, first in zip((north, east), found.corner_ne_m, strict=True)
        )
        return found.layers()[found.levels.index(level)][row * found.columns + column]

    assert {2, 3, 4, 5} <= set(found.levels)
    assert (state(4, 4.05, 0.0), state(4, 2.05, -0.5)) == (CELL_OCCUPIED, CELL_FREE)
    assert state(2, 2.05, 0.75) == CELL_OCCUPIED, "the low box, in the layer in which it is"
