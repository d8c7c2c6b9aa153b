"""Crash-safe small files: replaced whole or appended to, and a thread that syncs them to disk."""

import errno
import io
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Generic, TypeVar

import msgspec

from gloc3.errors import UNREADABLE, Refused

T = TypeVar("T")


class AppendFile:
    """Bytes that are only ever added, whole or not at all, and read by their place.

    Args:
        file: open for appending, unbuffered or not.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = file.seek(0, os.SEEK_END)
        """In bytes."""

    def append(self, data: bytes) -> None:
        """Adds data and hands them to the operating system.

        Raises:
            OSError: they could not be written; the file is as it was.
        """
        try:
            self._file.seek(self.size)
            if self._file.write(data) != len(data):
                raise OSError(errno.ENOSPC, f"no room for {len(data)} bytes")
            self._file.flush()
        except OSError:
            with suppress(OSError):  # what comes behind a torn end would never be read again
                self._file.truncate(self.size)
            raise
        self.size += len(data)

    def read(self, begin: int, size: int) -> bytes:
        """Bytes of the file, also from other threads.

        Raises:
            OSError: they cannot be read.
        """
        if isinstance(self._file, io.BytesIO):
            return self._file.getvalue()[begin : begin + size]
        return os.pread(self._file.fileno(), size, begin)

    def close(self) -> None:
        """Closes the file.

        Raises:
            OSError: something is left that cannot be written.
        """
        self._file.close()


class DocumentFile(Generic[T]):
    """One value in a small JSON file that is replaced as a whole; never raises.

    The previous file is kept as `NAME.old` until the new one is on disk, so that one of them is always complete.

    Args:
        path: the file; its folder is created at the first write.
        type_: of the value.
    """

    def __init__(self, path: Path, type_: type[T]) -> None:
        self._path, self._previous, self._type = path, path.with_name(path.name + ".old"), type_
        self._written: bytes | None = None
        self._lock = threading.Lock()
        """Held while files are renamed or removed."""
        self._count = 0
        """Of the files written so far."""
        self._disk = DiskThread(path.name, self._bring_to_disk)
        self.problem = ""
        """Why the file cannot be read or written; empty where it can."""

    def read(self) -> T | None:
        """The value that was written last, or the one before where a power cut has torn it; None where there is none."""
        for path in (self._path, self._previous):
            try:
                self._written = path.read_bytes()
                value = msgspec.json.decode(self._written, type=self._type)
            except FileNotFoundError:
                continue
            except (OSError, *UNREADABLE) as error:
                self._written, self.problem = None, f"{self._path} cannot be read: {error}"
            else:
                self.problem = ""
                return value
        return None

    def write(self, value: T) -> None:
        """Replaces the file, unless it holds this value already."""
        data = msgspec.json.encode(value)
        if data == self._written:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._lock:
                is_moved = self._path.exists() and not self._previous.exists()
                if is_moved:
                    self._path.replace(self._previous)
                try:
                    replace_file(self._path, data)
                except OSError:
                    if is_moved:  # else the thread, which has the file before on disk by now, removes the only copy
                        self._previous.replace(self._path)
                    raise
                self._count += 1
        except OSError as error:
            self.problem = f"{self._path} cannot be written: {error.strerror or error}"
        else:
            self._written, self.problem = data, ""
            self._disk.request()

    def _bring_to_disk(self) -> None:
        count = self._count
        sync(self._path)
        sync(self._path.parent)
        with self._lock:
            if count == self._count:
                self._previous.unlink(missing_ok=True)


class DiskThread:
    """Waits for the disk in a thread, which lives as long as data is being written.

    Args:
        name: name of the file for users.
        bring: returns when all written data is on disk, or raises `OSError`.
    """

    def __init__(self, name: str, bring: Callable[[], None]) -> None:
        self._name, self._bring = name, bring
        self._changed = threading.Condition()
        self._requested = self._settled = 0
        """Requests, and how many of them the disk has taken, or failed to take."""
        self._is_running = False
        self._error: OSError | None = None

    def request(self) -> None:
        """Requests that the written data is brought to disk."""
        with self._changed:
            self._requested += 1
            if not self._is_running:
                threading.Thread(target=self._run, name=f"disk: {self._name}").start()  # there may be no memory for one
                self._is_running = True

    def mark(self) -> int:
        """A number for all requests so far."""
        return self._requested

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether the requests up to a mark are done, after waiting at most `most_s`."""
        with self._changed:
            return self._changed.wait_for(lambda: self._settled >= mark, most_s)

    def check(self) -> None:
        """Repeats requests that have failed since the last check.

        Raises:
            OSError: the disk has failed.
        """
        with self._changed:
            error, self._error = self._error, None
        if error is not None:
            self.request()
            raise error

    def _run(self) -> None:
        """Runs until all data, including data written meanwhile, is on disk."""
        while True:
            with self._changed:
                requested = self._requested
            error: OSError | None = None
            try:
                self._bring()
            except OSError as found:
                error = found
            with self._changed:
                self._error, self._settled = error, requested
                self._is_running = error is None and self._requested != requested
                self._changed.notify_all()
                if not self._is_running:
                    return


def replace_file(path: Path, data: bytes, beside: Path | None = None) -> None:
    """Replaces a file atomically, or leaves the previous one.

    Args:
        path: the file; its folder must exist.
        data: the new content.
        beside: temporary file that is written first; by default a hidden file in the same folder.

    Raises:
        OSError: it cannot be written.
    """
    half = beside or path.with_name(f".{path.name}.new")
    half.write_bytes(data)
    half.replace(path)


def replace_link(path: Path, target: str) -> None:
    """Has a symbolic link lead elsewhere, at one go, also on the disk.

    Args:
        path: the link, which need not be there yet; its folder must exist.
        target: where it leads.

    Raises:
        OSError: it cannot be replaced.
    """
    beside = path.with_name(f".{path.name}.new")
    beside.unlink(missing_ok=True)
    beside.symlink_to(target)
    beside.replace(path)
    sync(path.parent)


def sync(path: Path) -> None:
    """Returns when the disk has a file, or a folder's names.

    Raises:
        OSError: it has not.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_secret(path: Path, data: bytes) -> None:
    """Writes a new file that only its owner can read.

    Raises:
        Refused: it exists already.
    """
    try:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise Refused(f"{path} already exists; a key in use is not overwritten") from None
    with os.fdopen(number, "wb") as file:
        file.write(data)
