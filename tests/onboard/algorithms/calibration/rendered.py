"""Boards drawn as cameras with known lenses see them, for tests and evidence: true intrinsics, places and times."""

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gloc3.camera.geometry import project, unproject
from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.calibration.boards import AprilGrid, CalibrationBoard, Checkerboard

Floats = NDArray[np.float64]
Grey = NDArray[np.uint8]

FINE: Final = 2
"""Rays along each side of a pixel."""
PAPER, MARGIN_M, TABLE = 235.0, 0.03, 110.0
FACING: Final = Rotation.from_euler("x", np.pi)
"""Turns a board whose y is up and whose z is towards the viewer into a camera's axes."""
CAMERA: Final = CameraModel(
    width=480,
    height=360,
    focal_px=(402.0, 400.5),
    center_px=(243.2, 176.4),
    lens=Lens.RADTAN,
    distortion=(-0.28, 0.09, 0.0006, -0.0004),
)
FISHEYE: Final = CameraModel(
    width=480,
    height=360,
    focal_px=(231.0, 230.2),
    center_px=(238.7, 182.3),
    lens=Lens.EQUIDISTANT,
    distortion=(-0.02, 0.012, -0.008, 0.001),
)
CHECKERBOARD: Final = Checkerboard(9, 6, (0.025, 0.025))
GRID: Final = AprilGrid(6, 6, 0.03, 0.3)


class RenderedBoard:
    """A board's picture, dots per metre, and where its corner is."""

    def __init__(self, board: CalibrationBoard) -> None:
        match board:
            case Checkerboard():
                self.picture, self.per_m, self.origin_m = _checkerboard(board)
            case AprilGrid():
                self.picture, self.per_m, self.origin_m = _april_grid(board)
            case _:
                raise TypeError(board)
        self.middle_m = self.origin_m + 0.5 * np.array(self.picture.shape[::-1]) / self.per_m


def _checkerboard(board: Checkerboard) -> tuple[Floats, float, Floats]:
    dots = 40
    per_m = dots / board.square_m[0]
    rows, columns = np.mgrid[0 : board.rows + 1, 0 : board.columns + 1]
    squares = np.kron(np.where((rows + columns) % 2, PAPER, 20.0), np.ones((dots, dots)))
    edge = round(MARGIN_M * per_m)
    return (
        np.pad(squares, edge, constant_values=PAPER).astype(np.float32),
        per_m,
        -np.array(board.square_m) - edge / per_m,
    )


def _april_grid(board: AprilGrid) -> tuple[Floats, float, Floats]:
    """Drawn as Kalibr's own program draws it: border of two bits, tag 0 at the lower left, squares that join the corners."""
    cv2 = load_opencv()
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    bit = 10
    tag, gap = 10 * bit, round(10 * bit * board.spacing)
    height, width = (n * (tag + gap) + gap for n in (board.rows, board.columns))
    picture = np.full((height, width), PAPER)
    for row in range(board.rows + 1):
        for column in range(board.columns + 1):
            y, x = row * (tag + gap), column * (tag + gap)
            picture[y : y + gap, x : x + gap] = 20.0
            if row < board.rows and column < board.columns:
                bits = cv2.aruco.generateImageMarker(family, board.first_id + row * board.columns + column, 10, None, 2)
                upright = bits[::-1, ::-1]  # OpenCV has them upside down
                drawn = np.kron(np.where(upright > 127, PAPER, 20.0), np.ones((bit, bit)))
                picture[y + gap : y + gap + tag, x + gap : x + gap + tag] = drawn[::-1]  # y is up
    per_m, edge = tag / board.tag_m, round(MARGIN_M * tag / board.tag_m)
    return np.pad(picture, edge, constant_values=PAPER).astype(np.float32), per_m, np.full(2, -(gap + edge) / per_m)


class BoardRenderer:
    """Draws a board for one camera.

    Args:
        camera: its lens.
        board: the board.
        noise: standard deviation of the grey values.
    """

    def __init__(self, camera: CameraModel, board: CalibrationBoard, noise: float = 2.0) -> None:
        self.camera, self.drawn, self.noise = camera, RenderedBoard(board), noise
        self.shape = (FINE * camera.height, FINE * camera.width)

    @cached_property
    def rays(self) -> Floats:
        """Directions of all rays at one metre along the optical axis, (rows, columns, 2)."""
        steps = (np.arange(FINE) + 0.5) / FINE - 0.5
        columns, rows = (np.add.outer(np.arange(n), steps).ravel() for n in (self.camera.width, self.camera.height))
        x, y = np.meshgrid(columns, rows)
        flat = unproject(self.camera, np.column_stack((x.ravel(), y.ravel())))
        return flat.reshape(*self.shape, 2)

    def picture(self, pose: Floats, seed: int = 0) -> Grey:
        """The picture of the board at a pose: rotation vector and translation of `camera_from_board`."""
        cv2 = load_opencv()
        turn = Rotation.from_rotvec(pose[:3]).as_matrix()
        top, bottom, left, right = (FINE * edge for edge in self._bounds(turn, pose[3:]))
        plane = np.column_stack((turn[:, :2], pose[3:]))  # a place on the board to a ray, up to its length
        dots_from_m = np.eye(3) * self.drawn.per_m
        dots_from_m[:, 2] = [*(-self.drawn.origin_m * self.drawn.per_m - 0.5), 1.0]
        flat = self.rays[top:bottom, left:right]
        dots = cv2.perspectiveTransform(flat, dots_from_m @ np.linalg.inv(plane)).astype(np.float32)
        dots = np.nan_to_num(dots, nan=-1e6)
        shown = np.full(self.shape, TABLE, np.float32)
        shown[top:bottom, left:right] = cv2.remap(
            self.drawn.picture, dots, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=TABLE
        )
        small = cv2.resize(shown, (self.camera.width, self.camera.height), interpolation=cv2.INTER_AREA)
        small = cv2.GaussianBlur(small, (0, 0), 0.6)
        noisy = small + np.random.default_rng(seed).normal(0.0, self.noise, small.shape)
        found: Grey = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
        return found

    def _bounds(self, turn: Floats, shift: Floats) -> tuple[int, int, int, int]:
        """First and last rows and columns of the picture that the board may be in."""
        width_m, height_m = 2.0 * (self.drawn.middle_m - self.drawn.origin_m)
        edge = np.linspace(0.0, 1.0, 21)
        x, y = np.meshgrid(edge * width_m, edge * height_m)
        flat = np.column_stack((x.ravel(), y.ravel())) + self.drawn.origin_m
        pixels = project(self.camera, np.column_stack((flat, np.zeros(len(flat)))) @ turn.T + shift)
        low, high = np.nanmin(pixels, axis=0) - 8.0, np.nanmax(pixels, axis=0) + 9.0
        left, right = np.clip([low[0], high[0]], 0, self.camera.width).astype(int).tolist()
        top, bottom = np.clip([low[1], high[1]], 0, self.camera.height).astype(int).tolist()
        return top, bottom, left, right

    def poses(self, count: int, seed: int = 0, tilt_deg: float = 35.0, away: float = 1.0) -> list[Floats]:
        """Poses that show the board whole in all parts of the picture, tilted at random.

        Args:
            count: how many.
            seed: of the random numbers.
            tilt_deg: the largest tilt.
            away: distance, in those at which the board fills the picture's height.
        """
        random = np.random.default_rng(seed)
        height_m = self.drawn.picture.shape[0] / self.drawn.per_m
        found = []
        for number in range(count):
            tilts = np.radians(random.uniform(-tilt_deg, tilt_deg, 2))
            turn = Rotation.from_euler("xyz", [*tilts, random.uniform(-0.3, 0.3)]) * FACING
            distance_m = away * height_m * self.camera.focal_px[1] / self.camera.height * random.uniform(1.1, 1.7)
            spots = ((0.5, 0.5), (0.3, 0.3), (0.7, 0.3), (0.3, 0.7), (0.7, 0.7), (0.28, 0.5), (0.72, 0.5))
            share = np.array(spots[number % len(spots)]) * (self.camera.width, self.camera.height)
            ray = np.append(unproject(self.camera, share[None])[0], 1.0)
            middle = ray / np.linalg.norm(ray) * distance_m
            shift = middle - turn.apply([*self.drawn.middle_m, 0.0])
            found.append(np.concatenate((turn.as_rotvec(), shift)))
        return found


def pictures(renderer: BoardRenderer, poses: Sequence[Floats]) -> list[Grey]:
    """The pictures of all poses."""
    return [renderer.picture(pose, seed) for seed, pose in enumerate(poses)]
