"""Files of the onboard process: records that survive a crash, and pictures with their poses."""

import errno
import json
import os
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from gloc3.camera_model import CameraModel
from gloc3.log.recording import CAMERAS, POSES
from gloc3.opencv import load_opencv
from gloc3_onboard.devices import Rig
from gloc3_onboard.drivers.image_recorder import Picture

_HEADER: Final = struct.Struct("<II")
"""Length and CRC-32 of a record."""


class RecordFile:
    """Records, one after the other, each with its length and checksum; a torn end is cut off when it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)

    def load(self) -> list[bytes]:
        """All whole records, oldest first."""
        data = self._path.read_bytes() if self._path.exists() else b""
        records: list[bytes] = []
        at = 0
        while at + _HEADER.size <= len(data):
            length, checksum = _HEADER.unpack_from(data, at)
            record = data[at + _HEADER.size : at + _HEADER.size + length]
            if len(record) < length or zlib.crc32(record) != checksum:
                break
            records.append(record)
            at += _HEADER.size + length
        if at < len(data):
            with suppress(OSError):  # where that cannot be, nothing can be added behind it either
                os.truncate(self._path, at)
        return records

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record and does not return before it is on disk.

        Args:
            record: the new one.
            outlives_power_cut: waits until it is on disk; otherwise only the end of this process does no harm.

        Raises:
            OSError: it could not be written; the file is as it was.
        """
        is_new = not self._path.exists()
        framed = _framed(record)
        with self._path.open("ab", buffering=0) as file:
            whole = file.tell()
            try:
                if file.write(framed) != len(framed):
                    raise OSError(errno.ENOSPC, f"no room for a record of {len(framed)} bytes in {self._path.name}")
                if outlives_power_cut:
                    os.fsync(file.fileno())
            except OSError:
                # What comes behind a torn record would never be read again.
                os.truncate(self._path, whole)
                raise
        if is_new and outlives_power_cut:
            self._sync_folder()

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records at once.

        Args:
            records: the new ones.
            outlives_power_cut: waits until they are on disk; otherwise only the end of this process does no harm.
        """
        fresh = self._path.with_name(self._path.name + ".new")
        with fresh.open("wb") as file:
            file.write(b"".join(_framed(record) for record in records))
            if outlives_power_cut:
                file.flush()
                os.fsync(file.fileno())
        fresh.replace(self._path)
        if outlives_power_cut:
            self._sync_folder()

    def _sync_folder(self) -> None:
        """Puts the file's name on disk too: without it a power cut would bring back the file that was replaced."""
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _framed(record: bytes) -> bytes:
    return _HEADER.pack(len(record), zlib.crc32(record)) + record


class MemoryRecords:
    """Records for one run in virtual time; a restarted onboard process is given the same object."""

    def __init__(self) -> None:
        self._records: list[bytes] = []

    def load(self) -> list[bytes]:
        """All records, oldest first."""
        return list(self._records)

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record."""
        self._records.append(record)

    def rewrite(self, records: list[bytes]) -> None:
        """Replaces all records."""
        self._records = list(records)


class PictureFolder:
    """Writes pictures as PNG, and their poses as `poses.jsonl` beside them.

    Args:
        folder: where to.
        rig: what is known of the cameras; goes into `cameras.json`, for reports of what was seen.
    """

    def __init__(self, folder: Path, rig: Rig | None = None) -> None:
        self._folder, self._rig = folder, rig
        self._cameras: dict[str, CameraModel | None] = {}

    def highest(self, camera: str) -> int:
        """The greatest number of a camera's picture that is there already; 0 for none."""
        numbers = [path.stem.removeprefix(f"{camera}-") for path in self._folder.glob(f"{camera}-*.png")]
        return max((int(number) for number in numbers if number.isdecimal()), default=0)

    def write(self, picture: Picture) -> None:
        """Writes a picture with its pose; raises `OSError` where that fails."""
        import numpy as np

        cv2 = load_opencv()
        self._folder.mkdir(parents=True, exist_ok=True)
        image = picture.image
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
        is_fine, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not is_fine:
            raise OSError(f"{picture.file} cannot be encoded")
        half = self._folder / (picture.file + ".part")
        half.write_bytes(encoded.tobytes())
        half.replace(self._folder / picture.file)
        tag = {
            "file": picture.file,
            "t_s": round(picture.t_s, 6),
            "position_ned_m": picture.position_ned_m,
            "ned_from_frd_wxyz": picture.ned_from_frd,
        }
        with (self._folder / POSES).open("a") as file:
            file.write(json.dumps(tag) + "\n")
        self._tell_camera(image.camera)

    def _tell_camera(self, name: str) -> None:
        """Writes down what is known of a camera, once."""
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
        self.written = 0

    def highest(self, camera: str) -> int:
        """None is there."""
        return 0

    def write(self, picture: Picture) -> None:
        """Counts a picture."""
        self.written += 1
