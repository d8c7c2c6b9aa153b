"""The simulated depth camera: depths worked out by hand, noise, drop-outs, limits, the same picture again."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.messages.perception import DepthImage
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.depth_camera import DepthImager, SimulatedDepthCamera

TruthAt = Callable[..., Truth]
CLEAN = DepthImager(noise_m=0.0, drop_out=0.0, range_max_m=30.0)
HOLD = World.load("hold")
PLAIN = World(msgspec.structs.replace(HOLD.file, boxes={}, marker=None))


def depths_m(found: DepthImage) -> NDArray[np.float64]:
    return np.frombuffer(found.data, "<u2").reshape(found.height, found.width) * found.scale_m


def test_a_wall_ahead_has_one_depth_and_the_floor_another_in_each_row(truth_at: TruthAt) -> None:
    """The wall is at x = 21; a row that sees the floor sees it at height over slope."""
    found = depths_m(SimulatedDepthCamera(PLAIN, rig.DEPTH, CLEAN).capture(truth_at(PLAIN, (9.0, 4.0, 1.5))))
    camera_m = 21.0 - 9.0 - 0.12
    middle = found[int(rig.DEPTH.center_px[1])]
    assert middle[40:120] == pytest.approx(camera_m, abs=1e-3), "the depth is along the optical axis, not along the ray"
    height_m = 1.5 + 0.0973 + 0.02
    row = 80
    floor_m = height_m * rig.DEPTH.focal_px[1] / (row - rig.DEPTH.center_px[1])
    assert found[row] == pytest.approx(floor_m, abs=2e-3)


def test_noise_grows_with_the_square_of_the_depth_and_drop_outs_are_as_stated(truth_at: TruthAt) -> None:
    imager = DepthImager(noise_m=0.004, drop_out=0.05, range_max_m=12.0)
    camera = SimulatedDepthCamera(PLAIN, rig.DEPTH, imager, seed=4)
    for x_m, away_m in ((18.88, 2.0), (14.88, 6.0)):
        truth = truth_at(PLAIN, (x_m, 4.0, 4.0))
        true_m = camera.true_depths_m(truth)[30:60, 40:120]
        assert true_m == pytest.approx(away_m)
        found = [depths_m(camera.capture(msgspec.structs.replace(truth, t_s=0.1 * n))) for n in range(10)]
        seen = np.array(found)[:, 30:60, 40:120]
        assert (seen == 0.0).mean() == pytest.approx(0.05, abs=0.005)
        errors = (seen - true_m)[seen > 0.0]
        assert errors.std() == pytest.approx(0.004 * away_m**2, rel=0.05)
        assert errors.mean() == pytest.approx(0.0, abs=0.003)


def test_what_is_too_near_or_too_far_is_not_measured(truth_at: TruthAt) -> None:
    truth = truth_at(PLAIN, (9.0, 4.0, 4.0))
    for limits in ({"range_max_m": 11.0}, {"range_min_m": 13.0, "range_max_m": 20.0}):
        found = SimulatedDepthCamera(PLAIN, rig.DEPTH, msgspec.structs.replace(CLEAN, **limits)).capture(truth)
        assert not depths_m(found)[40:50, 40:120].any()


def test_the_same_moment_gives_the_same_picture_and_another_one_another(truth_at: TruthAt) -> None:
    camera, truth = SimulatedDepthCamera(HOLD, rig.DEPTH, DepthImager(), seed=1), truth_at(HOLD, (9.0, 4.0, 1.5))
    first = camera.capture(truth)
    later = camera.capture(msgspec.structs.replace(truth, t_s=truth.t_s + 0.1))
    assert camera.capture(truth) == first
    assert later.data != first.data
