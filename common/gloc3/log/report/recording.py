"""The pictures of a run with their poses, from its log or from the list beside the pictures."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.errors import UNREADABLE, Finding, InputError, Refused
from gloc3.log.reader import LogReader, find_log
from gloc3.log.record import PLATFORM_FILE
from gloc3.log.report.flight_path import FlightPath, read_flight_path
from gloc3.messages.frames import GeoPoint, LocalFrame, Quaternion, Vector3
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import ImageRecorded
from gloc3.platform.reader import read_platform

POSES: Final = "poses.jsonl"
"""Beside the pictures: one line a picture with its file, time and pose."""
CAMERAS: Final = "cameras.json"
"""Beside the pictures: the models of the cameras by name."""


class TakenPicture(msgspec.Struct, frozen=True):
    """One picture."""

    camera: str
    file: str
    t_s: float
    position_ned_m: Vector3
    ned_from_frd: Quaternion


class PictureRecording(msgspec.Struct, frozen=True):
    """The pictures of one run."""

    name: str
    """Of the folder or log."""
    folder: Path
    """Where the pictures are."""
    pictures: list[TakenPicture]
    """In order of time."""
    cameras: dict[str, CameraModel]
    """What is known of the cameras."""
    path: FlightPath | None = None
    """None without a log."""
    platform: str = ""
    bearings_deg: dict[str, float] = {}
    """Direction of the x axis of each of the platform's local frames, clockwise from north."""
    utc_offset_s: float | None = None
    """Offset from the log's times to UTC, in seconds since 1970; None where it is unknown."""

    def time_of(self, picture: TakenPicture, decimals: int) -> str:
        """When a picture was taken: the time of day where UTC is known, else seconds of the log's clock."""
        if self.utc_offset_s is None:
            return f"{picture.t_s:.{decimals}f} s"
        return f"{datetime.fromtimestamp(picture.t_s + self.utc_offset_s, UTC):%H:%M:%S.%f}"[: decimals - 6]

    @property
    def frame(self) -> tuple[str, LocalFrame] | None:
        """The platform's only local frame; None where there is another number of them."""
        if len(self.bearings_deg) != 1:
            return None
        ((name, bearing_deg),) = self.bearings_deg.items()
        return name, LocalFrame(GeoPoint(0.0, 0.0, 0.0), bearing_deg)

    def lifted(self, height_m: float) -> "PictureRecording":
        """The same, where poses are of a point so far below the body's origin, that cameras are placed from."""
        pictures = [
            msgspec.structs.replace(picture, position_ned_m=(north, east, down - height_m))
            for picture in self.pictures
            for north, east, down in (picture.position_ned_m,)
        ]
        return msgspec.structs.replace(self, pictures=pictures)


class _Line(msgspec.Struct, frozen=True):
    """A line of the list beside the pictures."""

    file: str
    t_s: float
    position_ned_m: Vector3
    ned_from_frd_wxyz: Quaternion


def read_recording(path: Path) -> PictureRecording:
    """Reads a run.

    Args:
        path: a log, or the folder of a run, or a folder of pictures with their list.

    Raises:
        InputError: a file in it cannot be read.
        Refused: there is neither a log nor a list of pictures.
    """
    if path.is_dir():
        if not any(path.glob("*.mcap")):
            return _of_list(path)
        path = find_log(path)
    elif not path.exists():
        raise Refused(f"{path}: no such log or folder")
    return _of_log(path)


def read_cameras(path: Path) -> dict[str, CameraModel]:
    """Reads models of cameras by name, as the run has written them.

    Raises:
        InputError: the file cannot be read as such.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, CameraModel])
    except (OSError, *UNREADABLE) as error:
        hint = f"write it as {CAMERAS} of a run: a camera model in JSON under each name"
        raise InputError([Finding(file=path.name, message=str(error), hint=hint)]) from error


def _of_log(log: Path) -> PictureRecording:
    folder = log.parent / log.stem.replace("log", "images", 1)
    with LogReader(log, TopicTable.installed().types) as reader:
        reader.require_ours("pictures with poses")
        pictures = [
            TakenPicture(
                camera=entry.envelope.payload.camera,
                file=entry.envelope.payload.file,
                t_s=entry.envelope.t_s,
                position_ned_m=entry.envelope.payload.position_ned_m,
                ned_from_frd=entry.envelope.payload.ned_from_frd,
            )
            for entry in reader.entries("image_recorded")
            if isinstance(entry.envelope.payload, ImageRecorded)
        ]
        attached = reader.attachments.get(PLATFORM_FILE)
        platform = read_platform(attached, PLATFORM_FILE) if attached is not None else None
        frames = platform.frames if platform is not None else {}
        described = platform.cameras if platform is not None else {}
        models = {name: model for name, model in described.items() if isinstance(model, CameraModel)}
        return PictureRecording(
            name=log.absolute().parent.name + ("" if log.stem == "log" else f", {log.stem}"),
            folder=folder,
            pictures=sorted(pictures, key=lambda picture: picture.t_s),
            cameras={**models, **_known_cameras(folder)},
            path=read_flight_path(reader),
            platform=reader.platform,
            bearings_deg={name: row.x_axis_bearing_deg for name, row in frames.items()},
            utc_offset_s=reader.utc_offset_ns / 1e9 if reader.utc_offset_ns else None,
        )


def _of_list(folder: Path) -> PictureRecording:
    folder = folder if (folder / POSES).exists() else folder / "images"
    if not (folder / POSES).exists():
        raise Refused(f"{folder.parent}: neither a log nor pictures with {POSES}")
    pictures = []
    for number, line in enumerate((folder / POSES).read_bytes().splitlines(), start=1):
        try:
            row = msgspec.json.decode(line, type=_Line)
        except UNREADABLE as error:
            raise InputError([Finding(file=POSES, line=number, message=str(error))]) from error
        camera = row.file.rpartition("-")[0] or row.file
        pictures.append(TakenPicture(camera, row.file, row.t_s, row.position_ned_m, row.ned_from_frd_wxyz))
    pictures.sort(key=lambda picture: picture.t_s)
    return PictureRecording(
        name=folder.absolute().name, folder=folder, pictures=pictures, cameras=_known_cameras(folder)
    )


def _known_cameras(folder: Path) -> dict[str, CameraModel]:
    return read_cameras(folder / CAMERAS) if (folder / CAMERAS).exists() else {}
