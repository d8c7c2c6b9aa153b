"""Pictures with their poses, as files, written in a thread."""

import json
from collections import deque
from collections.abc import Callable, Container, Iterable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Final

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.camera.picture_file import JPEG, PNG, PhotoTags, encode_picture
from gloc3.log.report.recording import CAMERAS, POSES
from gloc3_onboard.components.drivers.image_recorder import RecordedPicture
from gloc3_onboard.sensors.devices import Bell, Rig, Unwatch
from gloc3_onboard.sensors.pictures import pixels_for_people


class PictureFolder:
    """Writes pictures as JPEG or PNG with EXIF and XMP, and their poses to `poses.jsonl`.

    Args:
        folder: destination.
        rig: camera calibrations, stored in `cameras.json` for inspection reports, and in the pictures.
        utc_offset_s: from the platform's time to seconds since 1970; None while that is unknown.
        worker: one thread that writes, in order; None to write at once.
    """

    def __init__(
        self,
        folder: Path,
        rig: Rig | None = None,
        utc_offset_s: Callable[[], float | None] = lambda: None,
        worker: Executor | None = None,
    ) -> None:
        self._folder, self._rig, self._utc_offset_s, self._worker = folder, rig, utc_offset_s, worker
        self._cameras: dict[str, CameraModel | None] = {}
        self._bell = Bell()
        self._begun: deque[Future[RecordedPicture]] = deque()
        """Pictures that the thread has been given."""
        self._written: list[RecordedPicture] = []

    def highest(self, camera: str) -> int:
        """The greatest number of a camera's picture that is there already; 0 for none."""
        names = [path.stem for path in self._folder.glob(f"{camera}-*") if path.suffix in (JPEG, PNG)]
        numbers = [name.removeprefix(f"{camera}-") for name in names]
        return max((int(number) for number in numbers if number.isdecimal()), default=0)

    def write(self, picture: RecordedPicture) -> None:
        """Begins to write a picture with its pose; at once where there is no thread."""
        if self._worker is None:
            self._written.append(self._write(picture))
            self._bell.ring()
        else:
            future = self._worker.submit(self._write, picture)
            self._begun.append(future)
            future.add_done_callback(lambda _: self._bell.ring())

    def written(self, cameras: Container[str]) -> list[RecordedPicture]:
        """The pictures of some cameras that have been written since the last call, in their order.

        Raises:
            OSError: a picture could not be written.
        """
        while self._begun and self._begun[0].done():
            self._written.append(self._begun.popleft().result())
        found, self._written = _divided(self._written, cameras)
        return found

    def on_written(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called, from any thread, when a picture has been written or has failed."""
        return self._bell.listen(ready)

    def _write(self, picture: RecordedPicture) -> RecordedPicture:
        self._folder.mkdir(parents=True, exist_ok=True)
        image, file = picture.image, self._folder / picture.file
        self._write_calibration(image.camera)
        data = encode_picture(pixels_for_people(image), self._tags(picture), file.suffix, picture.quality)
        half = self._folder / (picture.file + ".part")
        half.write_bytes(data)
        half.replace(file)
        tag = {
            "file": picture.file,
            "t_s": round(picture.t_s, 6),
            "position_ned_m": picture.position_ned_m,
            "ned_from_frd_wxyz": picture.ned_from_frd,
        }
        with (self._folder / POSES).open("a") as poses:
            poses.write(json.dumps(tag) + "\n")
        return picture

    def _tags(self, picture: RecordedPicture) -> PhotoTags:
        offset_s = self._utc_offset_s()
        return PhotoTags(
            camera=picture.image.camera,
            ned_from_frd=picture.ned_from_frd,
            position_ned_m=picture.position_ned_m,
            origin_geo=picture.origin_geo,
            position_std_m=picture.position_std_m,
            utc_s=None if offset_s is None else picture.t_s + offset_s,
            model=self._cameras.get(picture.image.camera),
        )

    def _write_calibration(self, name: str) -> None:
        """Writes a camera's calibration, once."""
        if self._rig is None or name in self._cameras:
            return
        self._cameras[name] = self._rig.model(name)
        known = {name: model for name, model in sorted(self._cameras.items()) if model is not None}
        if known:
            half = self._folder / (CAMERAS + ".part")
            half.write_bytes(msgspec.json.format(msgspec.json.encode(known)) + b"\n")
            half.replace(self._folder / CAMERAS)


class NoPictures:
    """For runs that keep no files: pictures are counted and dropped."""

    def __init__(self) -> None:
        self.count = 0
        """Pictures taken."""
        self._bell: Final = Bell()
        self._written: list[RecordedPicture] = []

    def highest(self, camera: str) -> int:
        """None is there."""
        return 0

    def write(self, picture: RecordedPicture) -> None:
        """Counts a picture."""
        self.count += 1
        self._written.append(picture)
        self._bell.ring()

    def written(self, cameras: Container[str]) -> list[RecordedPicture]:
        """The pictures of some cameras since the last call."""
        found, self._written = _divided(self._written, cameras)
        return found

    def on_written(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a picture has been counted."""
        return self._bell.listen(ready)


def _divided(
    pictures: Iterable[RecordedPicture], cameras: Container[str]
) -> tuple[list[RecordedPicture], list[RecordedPicture]]:
    """Pictures of some cameras, and those of others."""
    found: list[RecordedPicture] = []
    others: list[RecordedPicture] = []
    for picture in pictures:
        (found if picture.image.camera in cameras else others).append(picture)
    return found, others
