"""Coverage: what is missing is told, and what to show next."""

import numpy as np
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, BoardRenderer
from tests.onboard.algorithms.calibration.scenes import seen

from gloc3_onboard.algorithms.calibration.coverage import BoardCoverage, covered, tilt_deg

SIZE = (CAMERA.width, CAMERA.height)
RENDERER = BoardRenderer(CAMERA, CHECKERBOARD)


def of(count: int, tilt_deg: float = 35.0) -> BoardCoverage:
    poses = RENDERER.poses(count, tilt_deg=tilt_deg)
    return covered(seen(CAMERA, CHECKERBOARD, poses), np.array(poses), SIZE)


def test_enough_pictures_lack_nothing() -> None:
    coverage = of(20)
    assert coverage.lacks() == []
    assert coverage.advice() == ""


def test_boards_that_are_never_tilted_are_told() -> None:
    lacks = of(20, tilt_deg=5.0).lacks()
    assert [text[:15] for text in lacks] == ["tilts up and do", "tilts left and "]
    assert "25 is the least" in lacks[0]
    assert "tilt the board" in of(20, tilt_deg=5.0).advice()


def test_a_board_in_one_place_covers_too_little() -> None:
    poses = [RENDERER.poses(7, seed=seed)[3] for seed in range(9)]
    coverage = covered(seen(CAMERA, CHECKERBOARD, poses), np.array(poses), SIZE)
    assert any("of the picture" in text for text in coverage.lacks())
    assert coverage.advice().startswith("hold the board in the upper ")


def test_a_view_is_new_by_its_place_its_tilt_or_its_distance() -> None:
    coverage = BoardCoverage(SIZE)
    (pose,) = RENDERER.poses(1)
    (view,) = seen(CAMERA, CHECKERBOARD, [pose])
    assert coverage.is_new(view, pose)
    coverage.add(view, pose)
    assert not coverage.is_new(view, pose)
    assert coverage.is_new(view, pose + np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert coverage.is_new(view, pose * np.array([1.0, 1.0, 1.0, 1.4, 1.4, 1.4]))
    assert coverage.is_new(view._replace(pixels=view.pixels + np.array([100.0, 0.0])), pose)


def test_tilts_are_those_of_the_normal() -> None:
    down, right = tilt_deg(np.array([np.radians(20.0), 0.0, 0.0, 0.0, 0.0, 1.0]))
    assert (round(abs(down), 6), round(right, 6)) == (20.0, 0.0)
