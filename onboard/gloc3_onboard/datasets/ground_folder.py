"""A data set of a downward camera, in the layout of EuRoC's folders.

    ground/data.csv      #timestamp [ns],filename: one line a picture
    ground/data/…        the pictures, grey
    ground/sensor.yaml   the calibration, in EuRoC's form; `T_BS` places the camera on the body, forward, right, down
    attitude.csv         #timestamp [ns],q_w,q_x,q_y,q_z: of the body on north, east and down; a heading of any origin
    height.csv           #timestamp [ns],height [m]: from the body's origin to the ground

All may also be in a folder `mav0`. Times of attitudes and heights need not be those of the pictures; none is used that
is more than `GAP_S` from a picture.
"""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3.errors import Finding, InputError, nearest
from gloc3.messages.frames import Quaternion, normalize
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.sensors.checks.recent import RecentAttitudes, RecentHeights

GAP_S: Final = 0.2
T = TypeVar("T")


class GroundFrame(NamedTuple):
    """One picture with the measurements at its time."""

    t_s: float
    file: Path
    ned_from_frd: Quaternion | None
    height_m: float
    """Not-a-number where there is none."""

    def pixels(self) -> NDArray[np.uint8]:
        """The picture, (rows, columns); an empty one where the file cannot be read."""
        cv2 = load_opencv()
        data = np.frombuffer(self.file.read_bytes(), np.uint8) if self.file.is_file() else np.zeros(0, np.uint8)
        found: Any = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
        return found if found is not None else np.zeros((0, 0), np.uint8)


class GroundFolder(NamedTuple):
    """The data set."""

    camera: CameraModel
    frames: list[GroundFrame]


def read_ground_folder(folder: Path, sensor: str = "ground") -> GroundFolder:
    """Reads the lists of a data set; pictures are loaded one by one later.

    Args:
        folder: the data set.
        sensor: the camera's folder.

    Raises:
        InputError: a part of it is missing or cannot be read.
    """
    if not folder.is_dir():
        message = "it is a file, not a folder" if folder.exists() else "there is no such folder"
        raise InputError([Finding(file=str(folder), message=message)])
    top = folder / "mav0" if (folder / "mav0").is_dir() else folder
    if not (top / sensor).is_dir():
        known = sorted(path.parent.name for path in top.glob("*/sensor.yaml"))
        hint = nearest(sensor, known) if known else ""
        raise InputError([Finding(file=str(top), message=f"there is no folder {sensor!r} in it", hint=hint)])
    camera = read_calibration(top / sensor / "sensor.yaml", axes="frd").camera()
    pictures = _rows(top / sensor / "data.csv", 2, lambda row: row[1].strip())
    attitudes = _rows(top / "attitude.csv", 5, lambda row: normalize(_four(row)))
    heights = _rows(top / "height.csv", 2, lambda row: float(row[1]))
    recent_attitudes, recent_heights = RecentAttitudes(GAP_S), RecentHeights(GAP_S)
    frames: list[GroundFrame] = []
    at = [0, 0]
    for t_s, name in pictures:
        while at[0] < len(attitudes) and attitudes[at[0]][0] <= t_s + GAP_S:
            recent_attitudes.put(*attitudes[at[0]], (0.0, 0.0, 0.0))
            at[0] += 1
        while at[1] < len(heights) and heights[at[1]][0] <= t_s + GAP_S:
            recent_heights.put(*heights[at[1]])
            at[1] += 1
        frames.append(GroundFrame(t_s, top / sensor / "data" / name, recent_attitudes.at(t_s), recent_heights.at(t_s)))
    if not frames:
        raise InputError([Finding(file=f"{sensor}/data.csv", message="there is no picture in it")])
    return GroundFolder(camera, frames)


def _rows(path: Path, columns: int, convert: Callable[[list[str]], T]) -> list[tuple[float, T]]:
    """Times in seconds with the converted remaining columns."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError([Finding(file=path.name, message=error.strerror or "cannot be read")]) from error
    found = []
    for line, row in enumerate(csv.reader(lines), start=1):
        if not row or row[0].startswith("#"):
            continue
        try:
            if len(row) < columns:
                raise ValueError(f"{len(row)} of {columns} columns")
            found.append((int(row[0]) * 1e-9, convert(row)))
        except ValueError as error:
            raise InputError([Finding(file=path.name, line=line, message=str(error))]) from error
    return found


def _four(row: list[str]) -> Quaternion:
    w, x, y, z = (float(value) for value in row[1:5])
    return (w, x, y, z)
