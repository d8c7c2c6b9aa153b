"""Records that survive the process, and a power cut, without anybody having to wait for the disk."""

import errno
import os
import struct
import threading
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol

_HEADER: Final = struct.Struct("<II")
"""Length and CRC-32 of a record."""
_COUNT: Final = struct.Struct("<I")
"""The first record of a file: how many follow it that were written with it."""


class Records(Protocol):
    """What a `RecordFile` can do."""

    def load(self) -> list[bytes]:
        """All whole records, oldest first."""

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record."""

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records at once."""

    def mark(self) -> int:
        """A number for all that was written so far."""

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether nothing of that is on its way to the disk any more, after a wait of at most so long."""

    def check(self) -> None:
        """Raises `OSError` if the disk has failed since this was asked last; then it is asked once more."""


class RecordFile:
    """Records, one after the other, each with its length and checksum; a torn end is cut off when it is read.

    What is written outlives this process at once. For a power cut the disk has to have it, which takes a card a second now
    and then: a thread waits for that, and `wait` tells whether it is so. `rewrite` begins a file of its own, `NAME.2` beside
    `NAME.1`; the older one goes when the newer is on disk, so that one of them is always whole.

    Args:
        path: the files' name, without the number.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._number = 0
        """Of the file that is written to; 0 before there is one."""
        self._changed = threading.Condition()
        self._written = self._settled = 0
        """Writes that are to outlive a power cut, and how many of them the disk has taken, or failed to take."""
        self._safe = self._named = 0
        """Numbers of the newest file that is on disk, and of that whose name is, too."""
        self._syncing: int | None = None
        """Number of the file for which a thread waits; 0 where it only begins, None where there is no thread."""
        self._error: OSError | None = None

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
                self._number = self._safe = number
                return records[1:]
            with suppress(OSError):  # the power went before it was on disk; the one before is there still
                path.unlink()
        return []

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record.

        Args:
            record: the new one.
            outlives_power_cut: the disk is asked for; otherwise only the end of this process does no harm.

        Raises:
            OSError: it could not be written; the file is as it was.
        """
        path, framed = self._file(self._number), _framed(record)
        if not path.exists():  # not yet, or somebody has deleted it
            self.rewrite([record], outlives_power_cut=outlives_power_cut)
            return
        with path.open("ab", buffering=0) as file:
            whole = file.tell()
            try:
                if file.write(framed) != len(framed):
                    raise OSError(errno.ENOSPC, f"no room for a record of {len(framed)} bytes in {path.name}")
            except OSError:
                # What comes behind a torn record would never be read again.
                os.truncate(path, whole)
                raise
        if outlives_power_cut:
            self._sync()

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records at once.

        Args:
            records: the new ones.
            outlives_power_cut: the disk is asked for; otherwise only the end of this process does no harm.

        Raises:
            OSError: they could not be written; the file is as it was.
        """
        half = self._path.with_name(self._path.name + ".new")
        half.parent.mkdir(parents=True, exist_ok=True)
        half.write_bytes(b"".join(map(_framed, [_COUNT.pack(len(records)), *records])))
        with self._changed:
            before = self._number
            half.replace(self._file(before + 1))
            self._number += 1
            if before not in (self._safe, self._syncing):
                self._file(before).unlink(missing_ok=True)
        if outlives_power_cut:
            self._sync()

    def mark(self) -> int:
        """A number for all that was written so far and is to outlive a power cut."""
        return self._written

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether nothing of that is on its way to the disk any more, after a wait of at most so long.

        Args:
            mark: what was written until `mark` gave this number.
            most_s: the longest wait; `check` tells whether it has arrived.
        """
        with self._changed:
            return self._changed.wait_for(lambda: self._settled >= mark, most_s)

    def check(self) -> None:
        """Has the disk take once more what it has failed to take.

        Raises:
            OSError: it has failed since this was asked last.
        """
        with self._changed:
            error, self._error = self._error, None
        if error is not None:
            self._sync()
            raise error

    def _sync(self) -> None:
        with self._changed:
            self._written += 1
            if self._syncing is None:
                self._syncing = 0
                threading.Thread(target=self._bring_to_disk, name=f"disk: {self._path.name}").start()

    def _bring_to_disk(self) -> None:
        """In a thread of its own: until everything that is written meanwhile is on disk, too."""
        while True:
            with self._changed:
                written, number = self._written, self._number
                self._syncing = number
            error: OSError | None = None
            try:
                _sync(self._file(number))
                if number != self._named:  # without its name, a power cut would bring back the file that was replaced
                    _sync(self._path.parent)
                    self._named = number
                for old in self._numbers():
                    if old < number:
                        self._file(old).unlink(missing_ok=True)
            except OSError as found:
                error = found
            with self._changed:
                self._error, self._settled = error, written
                if error is None:
                    self._safe = number
                is_done = error is not None or self._written == written
                if is_done:
                    self._syncing = None
                self._changed.notify_all()
            if is_done:
                return

    def _numbers(self) -> list[int]:
        found = (
            path.name.removeprefix(f"{self._path.name}.") for path in self._path.parent.glob(f"{self._path.name}.*")
        )
        return [int(number) for number in found if number.isdecimal()]

    def _file(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")


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


def _sync(path: Path) -> None:
    """Returns when the disk has a file, or a folder's names."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records."""
        self._records = list(records)

    def mark(self) -> int:
        """There is no disk to wait for."""
        return 0

    def wait(self, mark: int, most_s: float) -> bool:
        """So nobody does."""
        return True

    def check(self) -> None:
        """Nor one that fails."""
