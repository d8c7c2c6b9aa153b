"""Calibration boards, and how they are found in pictures: checkerboards, and Kalibr's grids of AprilTags."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

LEAST_TAGS: Final = 4
"""Tags of a grid that make a view of it."""
KALIBR_CORNERS: Final = (1, 0, 3, 2)
"""OpenCV's corners of a tag in Kalibr's order (lower left, lower right, upper right, upper left): OpenCV has AprilTags
upside down."""
APART_GREY: Final = 30.0
"""Grey values by which black is darker than what is around it: black squares that touch the corners of tags come off."""
LARGE_PX: Final = 1400
"""Pictures that are not so wide are enlarged for the detector: it loses tags of 30 pixels otherwise."""
MOST_CONTRAST: Final = 8.0
MOST_MOVED_PX: Final = 2.0
MOST_MOVED: Final = 0.08
"""A corner that the refinement moves farther, and farther than this share of a tag, is of something else."""
BORDERS: Final = (2, 1)
"""Widths of the black border of tags, in bits: Kalibr's, and everybody else's."""


class BoardView(NamedTuple):
    """A board in one picture."""

    points_m: Floats
    """Its corners that were found, (n, 3) on the board, whose z is 0."""
    pixels: Floats
    """Their columns and rows, (n, 2)."""
    picture: str
    """The picture's name."""
    t_s: float = 0.0


class CalibrationBoard(ABC):
    """A flat board with corners at known places: x to the right, y up, z towards the viewer for Kalibr's grids."""

    @abstractmethod
    def find(self, pixels: Pixels) -> tuple[Floats, Floats] | None:
        """Places on the board, (n, 3) in metres, and columns and rows, (n, 2), of the corners in a grey picture; None without the board."""

    def view(self, pixels: Pixels, picture: str, t_s: float = 0.0) -> BoardView | None:
        """The board in a grey picture; None where it is not there, or not whole enough."""
        found = self.find(pixels)
        return None if found is None else BoardView(*found, picture, t_s)

    def others(self, view: BoardView) -> Sequence[BoardView]:
        """The same view as it would be if the board were taken for one that is turned, where that can happen."""
        return ()


class Checkerboard(CalibrationBoard):
    """A checkerboard.

    Args:
        columns: inner corners along x.
        rows: inner corners along y.
        square_m: sides of a square along x and y.
    """

    def __init__(self, columns: int, rows: int, square_m: tuple[float, float]) -> None:
        self.columns, self.rows, self.square_m = columns, rows, square_m
        across, up = np.meshgrid(np.arange(columns) * square_m[0], np.arange(rows) * square_m[1])
        self.points_m: Final[Floats] = np.column_stack((across.ravel(), up.ravel(), np.zeros(columns * rows)))

    def find(self, pixels: Pixels) -> tuple[Floats, Floats] | None:
        """See `CalibrationBoard.find`."""
        cv2 = load_opencv()
        size = (self.columns, self.rows)
        is_found, corners = cv2.findChessboardCornersSB(pixels, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not is_found:
            flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
            is_found, corners = cv2.findChessboardCorners(pixels, size, flags=flags)
            if not is_found:
                return None
        corners = _refined(cv2, pixels, corners, _spacing_px(corners.reshape(-1, 2), self.columns))
        return self.points_m, corners.reshape(-1, 2).astype(np.float64)

    def others(self, view: BoardView) -> Sequence[BoardView]:
        """Turned by half: the pattern of the corners is the same."""
        return (view._replace(points_m=self.points_m[-1] - view.points_m),)


class AprilGrid(CalibrationBoard):
    """Kalibr's grid of AprilTags of the family 36h11; tag 0 is at the lower left, and small black squares may join them.

    Args:
        columns: tags along x.
        rows: tags along y.
        tag_m: side of a tag, with its black border.
        spacing: gap between tags as a share of the side.
        first_id: the least tag.
    """

    def __init__(self, columns: int, rows: int, tag_m: float, spacing: float, first_id: int = 0) -> None:
        self.columns, self.rows, self.tag_m, self.spacing, self.first_id = columns, rows, tag_m, spacing, first_id
        self._detectors: list[Any] = []

    def find(self, pixels: Pixels) -> tuple[Floats, Floats] | None:
        """See `CalibrationBoard.find`."""
        cv2 = load_opencv()
        times, shown = _enlarged(cv2, pixels)
        corners, tags = self._tags(cv2, shown)
        if len(tags) < LEAST_TAGS:
            return None
        found = (corners[:, KALIBR_CORNERS] + 0.5) / times - 0.5
        side_px = float(np.median(np.linalg.norm(found - np.roll(found, 1, axis=1), axis=2)))
        around_px = side_px * min(self.spacing, 0.3)
        refined = _refined(cv2, pixels, np.ascontiguousarray(found.reshape(-1, 1, 2)), around_px).reshape(-1, 2)
        is_near = np.linalg.norm(refined - found.reshape(-1, 2), axis=1) < max(MOST_MOVED_PX, MOST_MOVED * side_px)
        points = np.concatenate([self.corners_m(int(tag)) for tag in tags])
        return points[is_near], refined[is_near].astype(np.float64)

    def _tags(self, cv2: Any, pixels: Pixels) -> tuple[Any, Any]:
        """Corners, (n, 4, 2), and numbers of the tags of this grid, by the border that shows most of them."""
        most: tuple[Any, Any] = (np.zeros((0, 4, 2), np.float32), np.zeros(0, int))
        for detector in self._loaded(cv2):
            corners, tags, _ = detector.detectMarkers(pixels)
            kept = [] if tags is None else [n for n, tag in enumerate(tags.ravel()) if self._has(int(tag))]
            if len(kept) > len(most[1]):
                most = (np.array([corners[n] for n in kept], np.float32).reshape(-1, 4, 2), tags.ravel()[kept])
            if len(most[1]) >= LEAST_TAGS:
                break
        return most

    def corners_m(self, tag: int) -> Floats:
        """Places of a tag's corners in Kalibr's order, (4, 3)."""
        row, column = divmod(tag - self.first_id, self.columns)
        step = self.tag_m * (1.0 + self.spacing)
        x, y, side = column * step, row * step, self.tag_m
        return np.array([[x, y, 0.0], [x + side, y, 0.0], [x + side, y + side, 0.0], [x, y + side, 0.0]])

    def _has(self, tag: int) -> bool:
        return 0 <= tag - self.first_id < self.columns * self.rows

    def _loaded(self, cv2: Any) -> list[Any]:
        if not self._detectors:
            family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
            for border in BORDERS:
                settings = cv2.aruco.DetectorParameters()
                settings.markerBorderBits = border
                settings.adaptiveThreshConstant = APART_GREY
                settings.perspectiveRemovePixelPerCell = 8
                self._detectors.append(cv2.aruco.ArucoDetector(family, settings))
        return self._detectors


def _enlarged(cv2: Any, pixels: Pixels) -> tuple[int, Pixels]:
    """A picture for the detector, with its whole contrast, and how many times it is enlarged."""
    low, high = np.percentile(pixels, (2.0, 98.0)).tolist()
    times = 1 if max(pixels.shape) > LARGE_PX else 2
    shown = cv2.convertScaleAbs(pixels.astype(np.float32) - low, alpha=min(255.0 / max(high - low, 1.0), MOST_CONTRAST))
    return times, cv2.resize(shown, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC) if times > 1 else shown


def _refined(cv2: Any, pixels: Pixels, corners: Any, spacing_px: float) -> Any:
    """Corners to a fraction of a pixel, from a window that holds no second one."""
    half = int(np.clip(0.5 * spacing_px, 2, 11))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.002)
    return cv2.cornerSubPix(pixels, corners.astype(np.float32), (half, half), (-1, -1), stop)


def _spacing_px(corners: Floats, columns: int) -> float:
    along = np.linalg.norm(np.diff(corners.reshape(-1, columns, 2), axis=1), axis=2)
    return float(along.min())
