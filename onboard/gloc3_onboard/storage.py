"""Files of the onboard process: records that survive a crash, and pictures with their poses."""

import json
import os
import struct
import zlib
from pathlib import Path
from typing import Final

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
            self.rewrite(records)
        return records

    def append(self, record: bytes) -> None:
        """Adds a record and does not return before it is on disk."""
        with self._path.open("ab") as file:
            file.write(_HEADER.pack(len(record), zlib.crc32(record)) + record)
            file.flush()
            os.fsync(file.fileno())

    def rewrite(self, records: list[bytes]) -> None:
        """Replaces all records at once."""
        fresh = self._path.with_suffix(".new")
        with fresh.open("wb") as file:
            for record in records:
                file.write(_HEADER.pack(len(record), zlib.crc32(record)) + record)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self._path)


class MemoryRecords:
    """Records for one run in virtual time; a restarted onboard process is given the same object."""

    def __init__(self) -> None:
        self._records: list[bytes] = []

    def load(self) -> list[bytes]:
        """All records, oldest first."""
        return list(self._records)

    def append(self, record: bytes) -> None:
        """Adds a record."""
        self._records.append(record)

    def rewrite(self, records: list[bytes]) -> None:
        """Replaces all records."""
        self._records = list(records)


class PictureFolder:
    """Writes pictures as PNG, and their poses as `poses.jsonl` beside them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, picture: Picture) -> None:
        """Writes a picture with its pose; raises `OSError` where that fails."""
        import cv2
        import numpy as np

        self._folder.mkdir(parents=True, exist_ok=True)
        image = picture.image
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
        is_fine, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not is_fine:
            raise OSError(f"{picture.file} cannot be encoded")
        (self._folder / picture.file).write_bytes(encoded.tobytes())
        tag = {
            "file": picture.file,
            "t_s": round(picture.t_s, 6),
            "position_ned_m": picture.position_ned_m,
            "ned_from_frd_wxyz": picture.ned_from_frd,
        }
        with (self._folder / "poses.jsonl").open("a") as file:
            file.write(json.dumps(tag) + "\n")


class NoPictures:
    """For runs that keep no files: pictures are counted and dropped."""

    def __init__(self) -> None:
        self.written = 0

    def write(self, picture: Picture) -> None:
        """Counts a picture."""
        self.written += 1
