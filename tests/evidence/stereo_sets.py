"""Public stereo sets, what spoils their pictures, and a plain odometer to compare with."""

import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import msgspec
import numpy as np
from tests.data_folders import STEREO
from tests.onboard.algorithms.vision.moved_rest import rectified
from tests.onboard.algorithms.vision.trial import BOUND_95

from gloc3.camera.geometry import Array, matrix
from gloc3.camera.model import CameraModel
from gloc3.evaluation.trajectory import read_trajectory
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.vision.feature_message import odometry_of
from gloc3_onboard.algorithms.vision.features import MatcherOptions
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.stereo_motion import BEGUN, MotionOptions
from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer
from gloc3_onboard.calibration.mounting import FORWARD
from gloc3_onboard.datasets.stereo_set import read_stereo_set

SETS: Final = {
    "kitti_1": "KITTI, town, 1.2 m a step, 51 pairs",
    "kitti_2": "KITTI 01, motorway, 1.0 m a step, 51 pairs",
    "kitti_3": "KITTI 02, colour, 1.5 m a step, 20 pairs",
    "mh01": "EuRoC MH_01 in flight, 300 pairs",
}
"""Folders below GLOC3_STEREO: KITTI's form with poses.txt, or EuRoC's with truth.txt in TUM's form."""
MOST: Final = 300
MATCHING: Final = {"kitti": MatcherOptions(nearest_m=3.0), "mh01": MatcherOptions()}
MOTION: Final = MotionOptions(calibration_px=1.2, std_max_m=1.5)
RDF: Final[Array] = matrix(FORWARD)
"""Body from camera, for a camera that looks ahead."""
WARMED_UP: Final = 2


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Rectified pairs with the true poses of the left camera, in a body's axes."""

    name: str
    t_s: Array
    pairs: list[tuple[Picture, Picture]]
    position_m: Array
    rotation: Array
    left: CameraModel
    right: CameraModel

    @property
    def base_m(self) -> float:
        """Distance of the cameras."""
        return float(np.linalg.norm(self.right.position_frd_m))

    @property
    def path_m(self) -> float:
        """Length of the way."""
        return float(np.linalg.norm(np.diff(self.position_m, axis=0), axis=1).sum())


def read_drive(name: str) -> Drive:
    """A set from its folder."""
    folder = STEREO / name
    given = read_stereo_set(folder)
    if not name.startswith("kitti"):
        return _rectified_drive(name, folder)
    lever = np.array(given.left.position_frd_m)
    truth = read_trajectory(folder / "poses.txt")
    pairs = [
        (_pixels(one), _pixels(other)) for one, other in (record.load() for record in given.pairs[: len(truth.t_s)])
    ]
    rotation = truth.world_from_body[: len(pairs)] @ given.frd_from_own.T
    position = truth.position_m[: len(pairs)] + rotation @ lever
    left, right = (
        msgspec.structs.replace(each, position_frd_m=tuple((np.array(each.position_frd_m) - lever).tolist()))
        for each in (given.left, given.right)
    )
    t_s = np.array([record.log_s for record in given.pairs[: len(pairs)]])
    return _from_first(
        Drive(name=name, t_s=t_s, pairs=pairs, position_m=position, rotation=rotation, left=left, right=right)
    )


def _rectified_drive(name: str, folder: Path) -> Drive:
    given = read_stereo_set(folder)
    left, right, times, pairs = rectified(folder)
    truth = read_trajectory(folder / "truth.txt")
    nearest = [int(np.abs(truth.t_s - t_s).argmin()) for t_s in times[:MOST]]
    body = truth.world_from_body[nearest] @ given.frd_from_own.T
    size = (left.width, left.height)
    inner, bends = [], []
    for each in (given.left, given.right):
        (fx, fy), (cx, cy) = each.focal_px, each.center_px
        inner.append(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]))
        bends.append(np.array(each.distortion))
    to_right = matrix(given.right.frd_from_rdf).T
    shift = to_right @ (np.array(given.left.position_frd_m) - np.array(given.right.position_frd_m))
    turn = cv2.stereoRectify(
        inner[0],
        bends[0],
        inner[1],
        bends[1],
        size,
        to_right @ matrix(given.left.frd_from_rdf),
        shift.reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )[0]
    rotation = body @ matrix(given.left.frd_from_rdf) @ turn.T @ RDF.T
    position = truth.position_m[nearest] + body @ np.array(given.left.position_frd_m)
    t_s = np.array(times[:MOST])
    return _from_first(
        Drive(name=name, t_s=t_s, pairs=pairs[:MOST], position_m=position, rotation=rotation, left=left, right=right)
    )


def _from_first(drive: Drive) -> Drive:
    first = drive.rotation[0]
    return replace(
        drive, position_m=(drive.position_m - drive.position_m[0]) @ first, rotation=first.T @ drive.rotation
    )


def _pixels(image: Any) -> Picture:
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)


def _each(change: Callable[[Picture, np.random.Generator], Array]) -> Callable[[Drive], Drive]:
    def spoil(drive: Drive) -> Drive:
        random = np.random.default_rng(5)
        pairs = [
            (
                np.clip(change(one, random), 0, 255).astype(np.uint8),
                np.clip(change(other, random), 0, 255).astype(np.uint8),
            )
            for one, other in drive.pairs
        ]
        return replace(drive, pairs=pairs)

    return spoil


def _flash(drive: Drive) -> Drive:
    def lit(side: Picture) -> Picture:
        return np.asarray(np.clip(side * 2.5 + 30.0, 0, 255), np.uint8)

    return replace(drive, pairs=[(lit(a), lit(b)) if n % 7 == 4 else (a, b) for n, (a, b) in enumerate(drive.pairs)])


def _late(drive: Drive) -> Drive:
    rights = [drive.pairs[n - 1][1] if n % 7 == 4 else right for n, (_, right) in enumerate(drive.pairs)]
    return replace(drive, pairs=[(left, right) for (left, _), right in zip(drive.pairs, rights, strict=True)])


def _second(drive: Drive) -> Drive:
    return replace(
        drive,
        t_s=drive.t_s[::2],
        pairs=drive.pairs[::2],
        position_m=drive.position_m[::2],
        rotation=drive.rotation[::2],
    )


def _wrong(drive: Drive) -> Drive:
    """Focal length 1 % too long, the right camera pitched by 0.08 degrees."""
    focal = drive.left.focal_px[0] * 1.01

    def changed(camera: CameraModel, down_px: float) -> CameraModel:
        column, row = camera.center_px
        return msgspec.structs.replace(camera, focal_px=(focal, focal), center_px=(column, row + down_px))

    return replace(drive, left=changed(drive.left, 0.0), right=changed(drive.right, focal * np.radians(0.08)))


SPOILED: Final[dict[str, Callable[[Drive], Drive]]] = {
    "as they are": lambda drive: drive,
    "noise of 12 greys": _each(lambda side, random: side + random.normal(0.0, 12.0, side.shape)),
    "blur of 2.5 px": _each(lambda side, _: np.asarray(cv2.GaussianBlur(side, (0, 0), 2.5), np.float64)),
    "an eighth of the light": _each(lambda side, random: side * 0.12 + random.normal(0.0, 1.0, side.shape)),
    "a flash in every seventh": _flash,
    "every seventh right one late": _late,
    "every second pair": _second,
    "a wrong calibration": _wrong,
}


def errors(drive: Drive, position_m: Array) -> dict[str, float]:
    """Error at the end, and its root mean square on the way, both in percent of the path, laid over by the first pose."""
    away = np.linalg.norm(position_m - drive.position_m, axis=1)
    return {
        "end": float(100.0 * away[-1] / drive.path_m),
        "ate": float(100.0 * np.sqrt(np.mean(away**2)) / drive.path_m),
    }


def ours(drive: Drive) -> dict[str, float]:
    """What the stereo odometer makes of it."""
    odometer = StereoOdometer(drive.left, drive.right, MATCHING[drive.name.partition("_")[0]], MOTION)
    chain, places, costs_ms, squares, invalid = OdometryChain(), [], [], [], 0
    index = {t_s: n for n, t_s in enumerate(drive.t_s.tolist())}
    for n, (t_s, (left, right)) in enumerate(zip(drive.t_s.tolist(), drive.pairs, strict=True)):
        begin_s = time.process_time()
        motion = odometer.update(left, right, t_s)
        costs_ms.append(1e3 * (time.process_time() - begin_s))
        chain.add(odometry_of(motion, "stereo"), t_s)
        places.append(chain.position_m)
        invalid += not motion.is_valid and motion.reason != BEGUN
        if motion.is_valid:
            key = index[motion.reference_t_s]
            back = drive.rotation[key].T
            turn = (back @ drive.rotation[n]).T @ motion.rotation
            off = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
            error = np.concatenate([motion.position_m - back @ (drive.position_m[n] - drive.position_m[key]), off])
            squares.append(float(error @ np.linalg.solve(motion.covariance, error)))
    return {
        **errors(drive, np.array(places)),
        "ms": float(np.mean(costs_ms[WARMED_UP:])),
        "valid": 1.0 - invalid / len(places),
        "square": float(np.mean(squares)) / 6.0,
        "beyond": float(np.mean(np.array(squares) > BOUND_95)),
    }


def libviso2(drive: Drive, program: Path) -> dict[str, float]:
    """The same of libviso2."""
    with tempfile.NamedTemporaryFile() as file:
        for left, right in drive.pairs:
            file.write(left.tobytes() + right.tobytes())
        file.flush()
        camera = drive.left
        words = [camera.width, camera.height, camera.focal_px[0], *camera.center_px, drive.base_m, 1, 1]
        command = [str(program), file.name, *map(str, words)]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    numbers = np.array([[float(word) for word in line.split()] for line in text.splitlines()])
    places = numbers[:, :12].reshape(-1, 3, 4)[:, :, 3] @ RDF.T
    return {**errors(drive, places), "ms": float(numbers[WARMED_UP:, 13].mean())}


def plain(drive: Drive) -> dict[str, float]:
    """The same of corners, Lucas and Kanade's tracking, and RANSAC with three points at a time, from pair to pair."""
    camera = drive.left
    (focal, _), (column, row) = camera.focal_px, camera.center_px
    inner = np.array([[focal, 0.0, column], [0.0, focal, row], [0.0, 0.0, 1.0]])
    position, rotation, step = np.zeros(3), np.eye(3), (np.zeros(3), np.eye(3))
    places, costs_ms = [position], []
    for (left, right), (now, _) in zip(drive.pairs[:-1], drive.pairs[1:], strict=True):
        begin_s = time.process_time()
        corners = cv2.goodFeaturesToTrack(left, 600, 0.01, 12)
        if corners is not None:
            step = _by_corners(left, right, now, corners, inner, drive.base_m) or step
        costs_ms.append(1e3 * (time.process_time() - begin_s))
        position, rotation = position + rotation @ step[0], rotation @ step[1]
        places.append(position)
    return {**errors(drive, np.array(places)), "ms": float(np.mean(costs_ms[WARMED_UP:]))}


def _followed(of: Picture, into: Picture, corners: Any) -> tuple[Any, Any]:
    tracker: Any = cv2.calcOpticalFlowPyrLK
    found, is_found, _ = tracker(of, into, corners, None, winSize=(21, 21), maxLevel=3)
    return found, is_found


def _by_corners(
    left: Picture, right: Picture, now: Picture, corners: Any, inner: Array, base_m: float
) -> tuple[Array, Array] | None:
    there, seen = _followed(left, right, corners)
    then, again = _followed(left, now, corners)
    at, there, then = corners[:, 0], there[:, 0], then[:, 0]
    disparity = at[:, 0] - there[:, 0]
    good = (seen.ravel() == 1) & (again.ravel() == 1) & (np.abs(at[:, 1] - there[:, 1]) < 1.5) & (disparity > 1.0)
    if good.sum() < 8:
        return None
    depth = inner[0, 0] * base_m / disparity[good]
    points = np.column_stack([(at[good] - inner[:2, 2]) / inner[0, 0] * depth[:, None], depth]).astype(np.float64)
    cv2.setRNGSeed(7)
    is_found, turn, shift, inliers = cv2.solvePnPRansac(
        points, then[good].astype(np.float64), inner, None, iterationsCount=200, reprojectionError=1.0
    )
    if not is_found or inliers is None or len(inliers) < 8:
        return None
    back = np.asarray(cv2.Rodrigues(turn)[0].T, np.float64)
    return RDF @ (-back @ shift.ravel()), RDF @ back @ RDF.T
