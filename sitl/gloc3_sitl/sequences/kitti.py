"""Writes a stereo sequence in the form of KITTI's odometry benchmark: rectified pictures, times, calibration, poses."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.imager import Imager

RECTIFIED: Final = CameraModel(
    width=640,
    height=480,
    focal_px=(430.0, 430.0),
    center_px=(319.5, 239.5),
    position_frd_m=rig.FRONT_LEFT.position_frd_m,
)
"""The left camera as KITTI's are: rectified, the right one beside it with the same lens."""


def write_kitti(
    folder: Path, world: World, truths: Iterable[Truth], *, model: CameraModel = RECTIFIED, seed: int = 0
) -> int:
    """Writes a sequence.

    Args:
        folder: gets `image_0`, `image_1`, `times.txt`, `calib.txt`, `poses.txt`.
        world: scene.
        truths: vehicle state at each frame.
        model: the left camera, without distortion; the right one is `rig.BASELINE_M` to its right.
        seed: of noise and dust.

    Returns:
        The number of frames.
    """
    cv2 = load_opencv()
    x, y, z = model.position_frd_m
    right = msgspec.structs.replace(model, position_frd_m=(x, y + rig.BASELINE_M, z))
    cameras = [
        SimulatedCamera(world, side, Imager(name=name), seed) for side, name in ((model, "image_0"), (right, "image_1"))
    ]
    for camera in cameras:
        (folder / camera.imager.name).mkdir(parents=True, exist_ok=True)
    times: list[float] = []
    poses: list[Floats] = []
    for number, truth in enumerate(truths):
        for camera in cameras:
            file = folder / camera.imager.name / f"{number:06d}.png"
            cv2.imwrite(str(file), camera.capture(truth).pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        times.append(truth.t_s)
        poses.append(_pose(cameras[0], truth))
    start = np.linalg.inv(poses[0])
    _write(folder / "times.txt", [f"{t_s - times[0]:.6e}" for t_s in times])
    _write(folder / "poses.txt", [_numbers((start @ pose)[:3]) for pose in poses])
    _write(folder / "calib.txt", [f"P{number}: {_numbers(_projection(model, number))}" for number in range(4)])
    return len(times)


def _pose(camera: SimulatedCamera, truth: Truth) -> Floats:
    """`local_from_rdf` as a 4 by 4 matrix."""
    local_from_rdf, place = camera.pose(truth)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix(local_from_rdf), place
    return pose


def _projection(model: CameraModel, number: int) -> Floats:
    """P0 to P3: left and right in grey, and again as if in colour."""
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    shift = -fx * rig.BASELINE_M if number % 2 else 0.0
    return np.array([[fx, 0.0, cx, shift], [0.0, fy, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])


def _numbers(values: "np.ndarray[Any, np.dtype[np.float64]]") -> str:
    return " ".join(f"{value:.9e}" for value in values.ravel())


def _write(path: Path, lines: list[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
