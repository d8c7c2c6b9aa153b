"""Pairs of cameras from corners with known noise: place within what is claimed; pairs that were not exposed together."""

import numpy as np
import pytest
from msgspec.structs import replace
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, BoardRenderer
from tests.onboard.algorithms.calibration.scenes import seen

from gloc3.camera.model import Lens
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import BoardView
from gloc3_onboard.algorithms.calibration.bundle import then
from gloc3_onboard.algorithms.calibration.stereo_fit import ViewPair, fit_pair

RIGHT = replace(CAMERA, focal_px=(405.0, 403.2), center_px=(236.0, 181.0))
RIGHT_FROM_LEFT = np.array([0.01, -0.03, 0.005, -0.11, 0.002, 0.004])
SIZES = ((480, 360), (480, 360))


def pairs(count: int = 14, seed: int = 0) -> list[ViewPair]:
    poses = BoardRenderer(CAMERA, CHECKERBOARD).poses(count, seed)
    lefts = seen(CAMERA, CHECKERBOARD, poses, seed=seed)
    rights = seen(RIGHT, CHECKERBOARD, [then(RIGHT_FROM_LEFT, pose) for pose in poses], seed=seed + 100)
    return list(zip(lefts, [each._replace(picture=f"r{each.picture}") for each in rights], strict=True))


def test_the_place_of_the_right_camera_is_right_within_what_it_claims() -> None:
    sigmas = []
    for seed in range(3):
        fit = fit_pair(pairs(seed=seed), SIZES, Lens.RADTAN, CHECKERBOARD, has_k3=False)
        assert fit.right_from_left[3:] == pytest.approx(RIGHT_FROM_LEFT[3:], abs=5e-4)
        assert fit.apart == ()
        sigmas.append((fit.right_from_left - RIGHT_FROM_LEFT) / fit.std)
    assert np.abs(sigmas).max() < 4.0
    assert 0.3 < np.sqrt(np.mean(np.square(sigmas))) < 1.5


def test_pairs_that_were_not_exposed_together_are_named() -> None:
    given = pairs()
    later = pairs(seed=0)[5][1]
    assert later is not None
    given[5] = (given[5][0], later._replace(pixels=later.pixels + np.array([6.0, 2.0])))
    fit = fit_pair(given, SIZES, Lens.RADTAN, CHECKERBOARD, has_k3=False)
    ((names, error_px),) = fit.apart
    assert (names, error_px > 0.5) == ("05.png and r05.png", True)
    assert fit.pairs == 13
    assert fit.right_from_left[3:] == pytest.approx(RIGHT_FROM_LEFT[3:], abs=5e-4)


def test_a_checkerboard_that_one_camera_has_found_turned_by_half_is_turned_back() -> None:
    given = pairs()
    one, other = given[2]
    assert isinstance(other, BoardView)
    given[2] = (one, other._replace(points_m=CHECKERBOARD.points_m[-1] - other.points_m))
    fit = fit_pair(given, SIZES, Lens.RADTAN, CHECKERBOARD, has_k3=False)
    assert (fit.pairs, fit.apart) == (14, ())


def test_too_few_pairs_with_the_board_in_both_are_refused() -> None:
    given: list[ViewPair] = [(one, None) for one, _ in pairs()] + [(None, other) for _, other in pairs()] + pairs()[:3]
    with pytest.raises(Refused, match="both cameras see the board in 3 pairs, 5 are the least"):
        fit_pair(given, SIZES, Lens.RADTAN, CHECKERBOARD, has_k3=False)
