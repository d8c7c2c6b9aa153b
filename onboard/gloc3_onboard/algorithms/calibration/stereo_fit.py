"""Calibration of a pair of cameras: each alone, then both together with the place of the right one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gloc3.camera.model import Lens
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import BoardView, CalibrationBoard, Floats
from gloc3_onboard.algorithms.calibration.bundle import POSE, CameraRig, Sighting, inverse, project, solve, then
from gloc3_onboard.algorithms.calibration.lens_fit import LensFit, board_pose, fit_lens, model_of

LEAST_PAIRS: Final = 5
APART_TIMES: Final = 4.0
"""A pair whose error is so many times that of the two pictures alone was not exposed together."""
APART_PX: Final = 0.5
"""… and is larger than this."""
ROUGH_PX: Final = 4.0
"""The same of a first guess of the right camera's place."""

ViewPair = tuple[BoardView | None, BoardView | None]
"""The board in the left and in the right picture of one moment."""


@dataclass(frozen=True, kw_only=True)
class StereoFit:
    """A pair as it was calibrated."""

    left: LensFit
    right: LensFit
    right_from_left: Floats
    """Rotation vector and translation, (6,)."""
    std: Floats
    """Their standard deviations, (6,)."""
    pairs: int
    """Pairs in which both cameras have seen the board."""
    apart: tuple[tuple[str, float], ...]
    """Pairs that do not fit, with the error in pixels that they have together."""
    rms_px: float

    @property
    def baseline_m(self) -> float:
        """Distance of the optical centres."""
        return float(np.linalg.norm(self.right_from_left[3:]))


def fit_pair(
    pairs: Sequence[ViewPair],
    sizes: tuple[tuple[int, int], tuple[int, int]],
    lens: Lens,
    board: CalibrationBoard,
    *,
    has_k3: bool,
) -> StereoFit:
    """Calibrates a pair of cameras.

    Args:
        pairs: the board in the pictures of each moment.
        sizes: width and height of the left and of the right pictures.
        lens: the model of both lenses.
        board: the board.
        has_k3: whether radial and tangential lenses have k3.

    Raises:
        Refused: there are too few pairs, or no lens fits.
    """
    fits = [
        fit_lens([view for pair in pairs if (view := pair[side]) is not None], sizes[side], lens, has_k3=has_k3)
        for side in (0, 1)
    ]
    left, right = fits
    whole = [_matched(pair, left, right) for pair in pairs]
    both = [pair for pair in whole if pair is not None]
    if len(both) < LEAST_PAIRS:
        raise Refused(
            f"both cameras see the board in {len(both)} pairs, {LEAST_PAIRS} are the least: hold it where both see it whole"
        )
    guesses = [_guess(pair, board, left, right) for pair in both]
    middle = np.median([guess for _, guess in guesses], axis=0)
    rough_px = [_error_px(pair, right, then(middle, board_pose(left.model, pair[0]))) for pair, _ in guesses]
    most_px = max(ROUGH_PX, APART_TIMES * float(np.median(rough_px)))
    rough = list(zip(guesses, rough_px, strict=True))
    both = [pair for (pair, _), error_px in rough if error_px <= most_px]
    apart = [(_names(pair), error_px) for (pair, _), error_px in rough if error_px > most_px]
    if len(both) < LEAST_PAIRS:
        raise Refused(
            f"only {len(both)} of {len(guesses)} pairs agree where the right camera is: the cameras do not expose together"
        )
    alone_px = max(left.rms_px, right.rms_px)
    while True:
        begin = CameraRig(
            lens,
            np.array([left.intrinsics, right.intrinsics]),
            np.array([np.zeros(POSE), middle]),
            np.array([board_pose(left.model, pair[0]) for pair in both]),
        )
        sightings = [Sighting(side, moment, pair[side]) for moment, pair in enumerate(both) for side in (0, 1)]
        solution = solve(sightings, begin)
        parts = solution.residuals_px
        errors = [_rms(np.concatenate((parts[2 * n], parts[2 * n + 1]))) for n in range(len(both))]
        worst = int(np.argmax(errors))
        if errors[worst] <= max(APART_PX, APART_TIMES * alone_px) or len(both) == LEAST_PAIRS:
            break
        apart.append((_names(both[worst]), errors[worst]))
        del both[worst]
    cameras = [
        replace(
            fit,
            model=model_of(solution.rig.intrinsics[side], sizes[side], lens),
            std=np.sqrt(np.diag(solution.intrinsics_cov[side])),
            views=tuple(pair[side] for pair in both),
            poses=np.array([then(solution.rig.places[side], pose) for pose in solution.rig.poses]),
            residuals_px=parts[side::2],
            rms_px=_rms(np.concatenate(parts[side::2])),
        )
        for side, fit in enumerate(fits)
    ]
    return StereoFit(
        left=cameras[0],
        right=cameras[1],
        right_from_left=solution.rig.places[1],
        std=np.sqrt(np.diag(solution.places_cov[1])),
        pairs=len(both),
        apart=tuple(apart),
        rms_px=solution.rms_px,
    )


def _matched(pair: ViewPair, left: LensFit, right: LensFit) -> tuple[BoardView, BoardView] | None:
    """A pair that both have seen and that neither has left out, without the corners that do not fit."""
    one, other = (
        next((view for view in fit.views if each is not None and view.picture == each.picture), None)
        for each, fit in zip(pair, (left, right), strict=True)
    )
    return None if one is None or other is None else (one, other)


def _guess(
    pair: tuple[BoardView, BoardView], board: CalibrationBoard, left: LensFit, right: LensFit
) -> tuple[tuple[BoardView, BoardView], Floats]:
    """The pair with the right board turned as the left one is, and the `right_from_left` that follows: the least turn."""
    one, other = pair
    first = inverse(board_pose(left.model, one))
    found = [((one, each), then(board_pose(right.model, each), first)) for each in (other, *board.others(other))]
    return min(found, key=lambda candidate: float(np.linalg.norm(candidate[1][:3])))


def _error_px(pair: tuple[BoardView, BoardView], right: LensFit, pose: Floats) -> float:
    """How far the right picture's corners are from where a pose of the board puts them."""
    pixels, _ = project(right.model.lens, pair[1].points_m, pose, right.intrinsics)
    return _rms(pixels - pair[1].pixels)


def _names(pair: tuple[BoardView, BoardView]) -> str:
    return f"{pair[0].picture} and {pair[1].picture}"


def _rms(residuals: Floats) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))
