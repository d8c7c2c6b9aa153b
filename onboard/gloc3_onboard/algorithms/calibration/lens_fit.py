"""Calibration of one camera: OpenCV's first solution, pictures that fit badly left out, joint refinement."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.opencv import load_opencv
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import BoardView, Floats
from gloc3_onboard.algorithms.calibration.bundle import COEFFICIENTS, POSE, CameraRig, Sighting, project, solve

LEAST_VIEWS: Final = 3
BAD_TIMES: Final = 3.0
"""A picture whose error is so many times the median is left out."""
BAD_PX: Final = 0.5
"""… and is larger than this."""
BAD_CORNER_TIMES: Final = 6.0
"""A corner that is so many times the median away is left out."""
BAD_CORNER_PX: Final = 0.4
"""… if it is farther away than this."""
LEAST_CORNERS: Final = 0.8
"""Share of a picture's corners that must fit; of a picture with more bad ones all are kept, so that it is left out whole."""
FISHEYE_FOCALS: Final = (0.2, 0.25, 0.32, 0.4, 0.5, 0.65, 0.85, 1.1)
"""Focal lengths with which the search for a fisheye begins, as shares of the picture's width."""


@dataclass(frozen=True, kw_only=True)
class LensFit:
    """A camera as it was calibrated."""

    model: CameraModel
    std: Floats
    """Standard deviations of two focal lengths, column and row of the axis, and the coefficients."""
    views: tuple[BoardView, ...]
    """The views that were used."""
    poses: Floats
    """Poses of the board in them, rotation vector and translation of `camera_from_board`, (n, 6)."""
    residuals_px: tuple[Floats, ...]
    """What each view lacks: (m, 2), found less predicted."""
    left_out: tuple[tuple[str, float], ...]
    """Pictures that do not fit, with their errors in pixels."""
    rms_px: float

    @property
    def intrinsics(self) -> Floats:
        """Two focal lengths, column and row of the axis, coefficients."""
        return np.array([*self.model.focal_px, *self.model.center_px, *self.model.distortion])


def fit_lens(views: Sequence[BoardView], size: tuple[int, int], lens: Lens, *, has_k3: bool = False) -> LensFit:
    """Calibrates a camera.

    Args:
        views: views of one board.
        size: width and height of the pictures.
        lens: the model of its distortion.
        has_k3: whether a radial and tangential lens has k3; Kalibr's has none.

    Raises:
        Refused: there are fewer than three views, or no lens fits.
    """
    kept = list(views)
    left_out: list[tuple[str, float]] = []
    while True:
        if len(kept) < LEAST_VIEWS:
            raise Refused(f"{len(kept)} pictures with a board are not enough: it takes {LEAST_VIEWS} at least")
        begin = _begin(kept, size, lens, has_k3=has_k3)
        solution = solve([Sighting(0, moment, view) for moment, view in enumerate(kept)], begin)
        cleaned = _cleaned(kept, solution.residuals_px)
        if cleaned is not None:
            kept = cleaned
            continue
        errors = np.array([_rms(part) for part in solution.residuals_px])
        worst = int(errors.argmax())
        if errors[worst] <= max(BAD_PX, BAD_TIMES * float(np.median(errors))):
            break
        left_out.append((kept[worst].picture, float(errors[worst])))
        del kept[worst]
    return LensFit(
        model=model_of(solution.rig.intrinsics[0], size, lens),
        std=np.sqrt(np.diag(solution.intrinsics_cov[0])),
        views=tuple(kept),
        poses=solution.rig.poses,
        residuals_px=solution.residuals_px,
        left_out=tuple(left_out),
        rms_px=solution.rms_px,
    )


def model_of(intrinsics: Floats, size: tuple[int, int], lens: Lens) -> CameraModel:
    """The model of a camera with these intrinsics."""
    fx, fy, cx, cy, *coefficients = intrinsics.tolist()
    return CameraModel(
        width=size[0], height=size[1], focal_px=(fx, fy), center_px=(cx, cy), lens=lens, distortion=tuple(coefficients)
    )


def _cleaned(views: Sequence[BoardView], residuals_px: Sequence[Floats]) -> list[BoardView] | None:
    """The views without the few corners that lie far from where they should be; None if there are none."""
    away = [np.linalg.norm(part, axis=1) for part in residuals_px]
    most = max(BAD_CORNER_PX, BAD_CORNER_TIMES * float(np.median(np.concatenate(away))))
    fits = [part <= most for part in away]
    if all(part.all() or part.mean() < LEAST_CORNERS for part in fits):
        return None
    return [
        view._replace(points_m=view.points_m[part], pixels=view.pixels[part]) if part.mean() >= LEAST_CORNERS else view
        for view, part in zip(views, fits, strict=True)
    ]


def board_pose(model: CameraModel, view: BoardView) -> Floats:
    """Rotation vector and translation of `camera_from_board`, (6,), of the least reprojection error."""
    from gloc3.camera.geometry import unproject

    cv2 = load_opencv()
    flat = unproject(model, view.pixels)
    whole = np.isfinite(flat).all(axis=1)
    _, turn, shift = cv2.solvePnP(view.points_m[whole], flat[whole], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(view.points_m[whole], flat[whole], np.eye(3), None, turn, shift)
    return np.concatenate((turn.ravel(), shift.ravel()))


def _begin(views: Sequence[BoardView], size: tuple[int, int], lens: Lens, *, has_k3: bool) -> CameraRig:
    if lens is Lens.EQUIDISTANT:
        return min((_fisheye(views, size, share) for share in FISHEYE_FOCALS), key=lambda found: found[0])[1]
    cv2 = load_opencv()
    flags = 0 if has_k3 else cv2.CALIB_FIX_K3
    if lens is Lens.PINHOLE:
        flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_ZERO_TANGENT_DIST
    points = [view.points_m.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    try:
        _, matrix, coefficients, turns, shifts = cv2.calibrateCamera(points, pixels, size, None, None, flags=flags)
    except cv2.error as error:
        raise Refused(
            "no lens fits these pictures: the boards in them are perhaps all parallel to the picture, or the board's "
            "measures are wrong"
        ) from error
    count = COEFFICIENTS[lens] + (has_k3 and lens is Lens.RADTAN)
    own = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *coefficients.ravel()[:count]]
    poses = np.hstack((np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))))
    return CameraRig(lens, np.array([own]), np.zeros((1, POSE)), poses)


def _fisheye(views: Sequence[BoardView], size: tuple[int, int], share: float) -> tuple[float, CameraRig]:
    """A fisheye without coefficients whose focal length is a share of the width: its error, and the begin of a search.

    OpenCV's own calibration of fisheyes stops with an error where a board is near the edge.
    """
    own = np.array([size[0] * share, size[0] * share, 0.5 * size[0], 0.5 * size[1], 0.0, 0.0, 0.0, 0.0])
    model = model_of(own, size, Lens.EQUIDISTANT)
    poses = np.array([board_pose(model, view) for view in views])
    lacks = [
        project(Lens.EQUIDISTANT, view.points_m, pose, own)[0] - view.pixels
        for view, pose in zip(views, poses, strict=True)
    ]
    return _rms(np.concatenate(lacks)), CameraRig(Lens.EQUIDISTANT, own[None], np.zeros((1, POSE)), poses)


def _rms(residuals: Floats) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))
