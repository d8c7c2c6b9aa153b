"""Crash-safe records: appended with a checksum each, in a file that stays readable after a power cut."""

import os
import struct
import threading
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol

from gloc3.store.files import AppendFile, DiskThread, replace_file, sync

_HEADER: Final = struct.Struct("<II")
"""Length and CRC-32 of a record."""
_COUNT: Final = struct.Struct("<I")
"""The first record of a file: how many follow it that were written with it."""


class Records(Protocol):
    """Records that survive the process, in their order."""

    def load(self) -> list[bytes]:
        """All whole records, oldest first."""

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record."""

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records at once."""

    def mark(self) -> int:
        """A number for all that was written so far."""

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether no data up to the mark is still on its way to the disk, after waiting at most `most_s`."""

    def check(self) -> None:
        """Raises `OSError` if the disk has failed since the last check; the request is then repeated."""


class RecordFile:
    """File of records, each with its length and checksum; an incomplete end is cut off when it is read.

    `rewrite` starts a new file, `NAME.2` next to `NAME.1`; the older one is deleted when the newer one is on disk, so
    that one of them is always complete.

    Args:
        path: the files' name, without the number.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        """Held while files are renamed or removed."""
        self._number = 0
        """Of the file that is written to; 0 before there is one."""
        self._is_known = False
        """Whether that is the newest file; else there may be newer ones that could not be read."""
        self._safe = self._named = self._syncing = 0
        """Numbers of the newest file on disk, of the newest whose name is on disk, too, and of the last one to be
        synced."""
        self._disk = DiskThread(path.name, self._bring_to_disk)

    def load(self) -> list[bytes]:
        """All whole records, oldest first; none where there is no file yet.

        Raises:
            OSError: there can be none, or it cannot be read.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        for number in sorted(self._numbers(), reverse=True):
            path = self._file(number)
            data = path.read_bytes()
            records, end = _records(data)
            if records and len(records[0]) == _COUNT.size and len(records) > _COUNT.unpack(records[0])[0]:
                if end < len(data):
                    with suppress(OSError):  # where that cannot be, nothing can be added behind it either
                        os.truncate(path, end)
                self._number = self._safe = self._syncing = number
                self._is_known = True
                return records[1:]
            with suppress(OSError):  # the power went before it was on disk; the one before is there still
                path.unlink()
        return []

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record.

        Args:
            record: the new one.
            outlives_power_cut: whether it is brought to disk; otherwise it survives only the end of this process.

        Raises:
            OSError: it could not be written; the file is as it was.
        """
        path = self._file(self._number)
        if not self._is_known or not path.exists():  # not yet, or somebody has deleted it
            self.rewrite([record], outlives_power_cut=outlives_power_cut)
            return
        with path.open("ab", buffering=0) as file:
            AppendFile(file).append(_framed(record))
        if outlives_power_cut:
            self._disk.request()

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records at once.

        Args:
            records: the new ones.
            outlives_power_cut: whether they are brought to disk; otherwise they survive only the end of this process.

        Raises:
            OSError: they could not be written; the file is as it was.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        data = b"".join(map(_framed, [_COUNT.pack(len(records)), *records]))
        with self._lock:
            before = self._number if self._is_known else max(self._numbers(), default=0)
            replace_file(self._file(before + 1), data, beside=self._path.with_name(self._path.name + ".new"))
            self._number = before + 1
            if self._is_known and before not in (self._safe, self._syncing):
                self._file(before).unlink(missing_ok=True)
            self._is_known = True
        if outlives_power_cut:
            self._disk.request()

    def mark(self) -> int:
        """A number for all that was written so far and is to outlive a power cut."""
        return self._disk.mark()

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether no data up to the mark is still on its way to the disk, after waiting at most `most_s`.

        Args:
            mark: covers data written until `mark` returned this number.
            most_s: the longest wait; `check` reports whether it is on disk.
        """
        return self._disk.wait(mark, most_s)

    def check(self) -> None:
        """Repeats a write to disk that has failed.

        Raises:
            OSError: it has failed since the last check.
        """
        self._disk.check()

    def _bring_to_disk(self) -> None:
        with self._lock:
            number = self._syncing = self._number
        sync(self._file(number))
        if number != self._named:  # without its name, a power cut would bring back the file that was replaced
            sync(self._path.parent)
            self._named = number
        with self._lock:
            self._safe = number
        for previous in self._numbers():
            if previous < number:
                self._file(previous).unlink(missing_ok=True)

    def _numbers(self) -> list[int]:
        found = (
            path.name.removeprefix(f"{self._path.name}.") for path in self._path.parent.glob(f"{self._path.name}.*")
        )
        return [int(number) for number in found if number.isdecimal()]

    def _file(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")


class MemoryRecords:
    """Records for one run in virtual time; a restarted onboard process gets the same object."""

    def __init__(self) -> None:
        self._records: list[bytes] = []

    def load(self) -> list[bytes]:
        """All records, oldest first."""
        return list(self._records)

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record."""
        self._records.append(record)

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records."""
        self._records = list(records)

    def mark(self) -> int:
        """There is no disk to wait for."""
        return 0

    def wait(self, mark: int, most_s: float) -> bool:
        """Returns at once: nothing is on its way to a disk."""
        return True

    def check(self) -> None:
        """Nor one that fails."""


class RecordStore:
    """Records on a disk that may be full or broken; never raises: a vehicle flies without its disk.

    Records that could not be written are pending; until they are written, a restart would load an older state.

    Args:
        records: the file.
        what: name of the content for users: *progress*.
    """

    def __init__(self, records: Records, what: str) -> None:
        self._records, self._what = records, what
        self.problem = ""
        """Why the last was not kept or read; empty where it was."""
        self._is_failing = False
        """The last attempt to keep something has failed."""
        self._owed: list[tuple[bytes | list[bytes], bool]] = []
        """Pending writes, in order: a record or all of them, and whether it has to survive a power cut."""

    def load(self) -> list[bytes]:
        """All whole records, oldest first; none where they cannot be read."""
        try:
            return self._records.load()
        except OSError as error:
            self.problem = f"the kept {self._what} cannot be read: {error.strerror or error}"
            return []

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record."""
        self._owed.append((record, outlives_power_cut))
        self._write()

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records at once, including pending ones."""
        self._owed = [(records, outlives_power_cut)]
        self._write()

    def mark(self) -> int:
        """A number for all that was written so far."""
        return self._records.mark()

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether no data up to the mark is still on its way to the disk, after waiting at most `most_s`."""
        return self._records.wait(mark, most_s)

    def check(self) -> None:
        """Updates `problem`, and writes pending records."""
        try:
            self._records.check()
        except OSError as error:
            self._fail(error)
        else:
            if self._is_failing:
                self._write()

    def _write(self) -> None:
        try:
            while self._owed:
                data, is_durable = self._owed[0]
                if isinstance(data, list):
                    self._records.rewrite(data, outlives_power_cut=is_durable)
                else:
                    self._records.append(data, outlives_power_cut=is_durable)
                del self._owed[0]
        except OSError as error:
            self._fail(error)
        else:
            self._is_failing, self.problem = False, ""

    def _fail(self, error: OSError) -> None:
        self._is_failing = True
        self.problem = f"the {self._what} cannot be kept: {error.strerror or error}"


def _records(data: bytes) -> tuple[list[bytes], int]:
    """The whole records at the begin of some data, and where they end."""
    records: list[bytes] = []
    at = 0
    while at + _HEADER.size <= len(data):
        length, checksum = _HEADER.unpack_from(data, at)
        record = data[at + _HEADER.size : at + _HEADER.size + length]
        if len(record) < length or zlib.crc32(record) != checksum:
            break
        records.append(record)
        at += _HEADER.size + length
    return records, at


def _framed(record: bytes) -> bytes:
    return _HEADER.pack(len(record), zlib.crc32(record)) + record
