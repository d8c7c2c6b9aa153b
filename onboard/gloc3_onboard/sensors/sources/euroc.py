"""The folders of EuRoC's data sets (`mav0/cam0/data.csv` and so on) as recorded data."""

import csv
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from gloc3.errors import Finding, InputError, nearest
from gloc3.messages.frames import Quaternion, rotate
from gloc3.messages.perception import ImuSample
from gloc3.messages.vehicle import Image
from gloc3_onboard.calibration.mounting import frd_from_axes
from gloc3_onboard.sensors.camera_sources.camera import EYES, camera_name
from gloc3_onboard.sensors.camera_sources.stereo import STEREO, pair_names
from gloc3_onboard.sensors.pictures import load_picture
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded, matching
from gloc3_onboard.sensors.source_url import REPLAY

AXES: Final = "urf"
"""Of EuRoC's body and inertial unit: x up, y right, z forward."""


def sensor_folder(folder: Path, sensor: str) -> Path:
    """The folder of a sensor, below the data set or its `mav0`.

    Raises:
        InputError: there is none.
    """
    top = folder / "mav0" if (folder / "mav0").is_dir() else folder
    if (top / sensor / "data.csv").is_file():
        return top / sensor
    known = sorted(path.parent.name for path in top.glob("*/data.csv"))
    message = f"no data set of EuRoC's kind with {sensor}/data.csv, nor of KITTI's with calib.txt"
    if known or (folder / "mav0").is_dir():
        message = f"there is no {sensor}/data.csv in it"
    raise InputError([Finding(file=str(folder), message=message, hint=nearest(sensor, known) if known else "")])


def camera_records(folder: Path, sensor: str, name: str) -> Sequence[Recorded[Image]]:
    """The frames of one camera.

    Raises:
        InputError: they are not there, or the list is damaged.
    """
    place = sensor_folder(folder, sensor)
    return [
        Recorded(stamp_s, partial(load_picture, place / "data" / row[1], name))
        for stamp_s, row in _rows(place / "data.csv", 2)
    ]


def stereo_records(folder: Path, names: tuple[str, str]) -> Sequence[Recorded[tuple[Image, Image]]]:
    """The pairs of cam0 and cam1 that have the same stamp.

    Raises:
        InputError: they are not there, or a list is damaged.
    """
    left, right = (camera_records(folder, sensor, name) for sensor, name in zip(("cam0", "cam1"), names, strict=True))
    return matching(left, right)


def imu_records(folder: Path, sensor: str, axes: str = AXES) -> Sequence[Recorded[ImuSample]]:
    """Samples of an inertial unit, on FRD axes.

    Args:
        folder: the data set.
        sensor: the unit's folder in it.
        axes: where x, y and z of the file point.

    Raises:
        InputError: the file is missing or damaged.
        Refused: the axes are invalid.
    """
    place = sensor_folder(folder, sensor)
    frd_from_imu = frd_from_axes(axes)
    return [
        Recorded(stamp_s, partial(_sample, frd_from_imu, tuple(map(float, row[1:7]))))
        for stamp_s, row in _rows(place / "data.csv", 7, are_numbers=True)
    ]


def _sample(frd_from_imu: Quaternion, values: tuple[float, ...]) -> ImuSample:
    p, q, r, fx, fy, fz = values
    return ImuSample(
        rate_frd_rad_s=rotate(frd_from_imu, (p, q, r)), specific_force_frd_m_s2=rotate(frd_from_imu, (fx, fy, fz))
    )


def _rows(path: Path, columns: int, *, are_numbers: bool = False) -> Iterator[tuple[float, list[str]]]:
    """Stamps in seconds with their rows."""
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        for line, row in enumerate(csv.reader(file), start=1):
            if not row or row[0].startswith("#"):
                continue
            try:
                if len(row) < columns:
                    raise ValueError(f"{len(row)} of {columns} columns")
                stamp_s = int(row[0]) * 1e-9
                if are_numbers:
                    [float(value) for value in row[1:columns]]
            except ValueError as error:
                raise InputError([Finding(file=str(path), line=line, column=1, message=str(error))]) from error
            yield stamp_s, [value.strip() for value in row]


def _make(request: SourceRequest) -> Any:
    path, part = request.path, request.url.part
    match request.sensor.name:
        case "imu":
            return request.replayed(partial(imu_records, path, part or "imu0"))
        case name if name == STEREO:
            return request.replayed(partial(stereo_records, path, pair_names(request.device)))
    return request.replayed(partial(camera_records, path, part or "cam0", camera_name(request.device)))


SOURCES: Final = (
    SourceKind("euroc", (*EYES, "imu"), "euroc://V1_01_easy#cam0", _make, REPLAY, takes_part=True, is_file=True),
)
