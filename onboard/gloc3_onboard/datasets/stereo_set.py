"""Recorded stereo pictures with their calibration: folders of EuRoC's and KITTI's kinds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.camera.geometry import Array, matrix
from gloc3.camera.model import CameraModel
from gloc3.errors import Finding, InputError
from gloc3.messages.perception import ImuSample
from gloc3.messages.vehicle import Image
from gloc3_onboard.calibration.mounting import FORWARD, frd_from_axes
from gloc3_onboard.calibration.reader import CalibrationFile, read_calibration
from gloc3_onboard.sensors.pictures import picture_size
from gloc3_onboard.sensors.replay import Recorded
from gloc3_onboard.sensors.sources import euroc, kitti

_NAMES: Final = ("left", "right")
_KITTI_PAIRS: Final = {"image_0": ("image_1", "P0", "P1"), "image_2": ("image_3", "P2", "P3")}


@dataclass(frozen=True, kw_only=True)
class StereoSet:
    """Pairs of pictures in order of time."""

    left: CameraModel
    right: CameraModel
    pairs: Sequence[Recorded[tuple[Image, Image]]]
    frd_from_own: Array
    """From the axes that the data set's truth has for the body to ours."""
    imu: Sequence[Recorded[ImuSample]] = ()
    """Samples of the inertial unit in order of time, if they were asked for."""


@dataclass(frozen=True, kw_only=True)
class MonoSet:
    """Pictures of one camera in order of time."""

    camera: CameraModel
    pictures: Sequence[Recorded[Image]]
    frd_from_own: Array


def read_stereo_set(folder: Path, *, with_imu: bool = False) -> StereoSet:
    """A data set's stereo pictures.

    Args:
        folder: the data set.
        with_imu: whether to read its inertial unit, `imu0` of EuRoC's form, too.

    Raises:
        InputError: it is none, or something is wrong in it.
    """
    if _is_kitti(folder):
        if with_imu:
            raise _wrong(folder, "a set of KITTI's form has no inertial unit", "leave --imu out")
        part = next((part for part in _KITTI_PAIRS if (folder / part).is_dir()), "")
        if not part:
            raise _wrong(folder, "it has neither image_0 nor image_2", "for one camera alone say --mono")
        _, left, right = _KITTI_PAIRS[part]
        calibration = _kitti_calibration(folder, part)
        return StereoSet(
            left=calibration.camera(left),
            right=calibration.camera(right),
            pairs=kitti.stereo_records(folder, part, _NAMES),
            frd_from_own=matrix(FORWARD),
        )
    left_place, right_place = (euroc.sensor_folder(folder, sensor) for sensor in ("cam0", "cam1"))
    return StereoSet(
        left=read_calibration(left_place / "sensor.yaml").camera(),
        right=read_calibration(right_place / "sensor.yaml").camera(),
        pairs=euroc.stereo_records(folder, _NAMES),
        frd_from_own=matrix(frd_from_axes(euroc.AXES)),
        imu=euroc.imu_records(folder, "imu0") if with_imu else (),
    )


def read_mono_set(folder: Path) -> MonoSet:
    """The pictures of a data set's left, or only, camera.

    Raises:
        InputError: it is none, or something is wrong in it.
    """
    if _is_kitti(folder):
        parts = sorted(path.name for path in folder.glob("image*") if path.is_dir())
        if not parts:
            raise _wrong(folder, "it has no folder of pictures")
        calibration = _kitti_calibration(folder, parts[0])
        return MonoSet(
            camera=calibration.camera("P2" if parts[0] == "image_2" else "P0"),
            pictures=kitti.camera_records(folder, parts[0], _NAMES[0]),
            frd_from_own=matrix(FORWARD),
        )
    place = euroc.sensor_folder(folder, "cam0")
    return MonoSet(
        camera=read_calibration(place / "sensor.yaml").camera(),
        pictures=euroc.camera_records(folder, "cam0", _NAMES[0]),
        frd_from_own=matrix(frd_from_axes(euroc.AXES)),
    )


def times_of(records: Sequence[Recorded[Image]] | Sequence[Recorded[tuple[Image, Image]]]) -> Array:
    """The data set's own times, (n,)."""
    return np.array([record.log_s for record in records], np.float64)


def _is_kitti(folder: Path) -> bool:
    if not folder.is_dir():
        raise _wrong(folder, "it is a file, not a folder" if folder.exists() else "there is no such folder")
    return (folder / "calib.txt").is_file()


def _kitti_calibration(folder: Path, part: str) -> CalibrationFile:
    return read_calibration(folder / "calib.txt", size=picture_size(folder / part) or picture_size(folder))


def _wrong(folder: Path, message: str, hint: str = "") -> InputError:
    return InputError([Finding(file=str(folder), message=message, hint=hint)])
