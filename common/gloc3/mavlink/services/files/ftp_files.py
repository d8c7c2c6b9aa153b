"""The files that MAVLink FTP may touch: an interface, and one folder of this computer behind it."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Protocol

from gloc3.mavlink.services.files.ftp import FolderEntry


class Files(Protocol):
    """Files by path, "/" being the top; every method may raise `OSError`."""

    def entries(self, path: str) -> list[FolderEntry]:
        """What a folder holds, sorted."""

    def size(self, path: str) -> int:
        """Of a file, in bytes."""

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Bytes of a file; fewer or none behind its end."""

    def create(self, path: str) -> None:
        """Makes an empty file, or empties one."""

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Writes into an existing file."""

    def truncate(self, path: str, size: int) -> None:
        """Cuts a file off, or fills it up with zeros."""

    def remove(self, path: str) -> None:
        """Removes a file."""

    def make_folder(self, path: str) -> None:
        """Makes a folder."""

    def remove_folder(self, path: str) -> None:
        """Removes an empty folder."""

    def rename(self, path: str, new_path: str) -> None:
        """Moves a file or folder; never over an existing one."""


class FolderFiles:
    """One folder of this computer. Nothing outside it can be reached: no `..`, and no link that leads outside.

    Args:
        folder: must exist.
        is_writable: if false, refuses all changes.
        most_bytes: the largest file that a client may write.
    """

    def __init__(self, folder: Path, *, is_writable: bool = True, most_bytes: int = 1 << 30) -> None:
        self._folder = folder.resolve(strict=True)
        self._is_writable = is_writable
        self._most_bytes = most_bytes

    def entries(self, path: str) -> list[FolderEntry]:
        """Entries of a folder; links that lead outside, and anything that is not a file or folder, are left out."""
        found = []
        for child in sorted(self._find(path).iterdir()):
            with contextlib.suppress(OSError):
                real = self._check(child.resolve(strict=True))
                if real.is_dir():
                    found.append(FolderEntry(child.name, True))
                elif real.is_file():
                    found.append(FolderEntry(child.name, False, real.stat().st_size))
        return found

    def size(self, path: str) -> int:
        """Of a file, in bytes."""
        return self._file(path).stat().st_size

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Bytes of a file."""
        with self._file(path).open("rb") as file:
            file.seek(offset)
            return file.read(size)

    def create(self, path: str) -> None:
        """Makes an empty file, or empties one."""
        self._may_write(0)
        self._find(path).write_bytes(b"")

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Writes into an existing file."""
        self._may_write(offset + len(data))
        with self._file(path).open("r+b") as file:
            file.seek(offset)
            file.write(data)

    def truncate(self, path: str, size: int) -> None:
        """Cuts a file off, or fills it up with zeros."""
        self._may_write(size)
        with self._file(path).open("r+b") as file:
            file.truncate(size)

    def remove(self, path: str) -> None:
        """Removes a file."""
        self._may_write(0)
        self._file(path).unlink()

    def make_folder(self, path: str) -> None:
        """Makes a folder."""
        self._may_write(0)
        self._find(path).mkdir()

    def remove_folder(self, path: str) -> None:
        """Removes an empty folder."""
        self._may_write(0)
        found = self._find(path)
        if found == self._folder:
            raise PermissionError("the top folder stays")
        found.rmdir()

    def rename(self, path: str, new_path: str) -> None:
        """Moves a file or folder; never over an existing one."""
        self._may_write(0)
        source, destination = self._find(path), self._find(new_path)
        if source == self._folder:
            raise PermissionError("the top folder stays")
        if destination.exists():
            raise FileExistsError(new_path)
        source.rename(destination)

    def _find(self, path: str) -> Path:
        """Resolves a path, whether or not something exists there."""
        parts = [part for part in path.split("/") if part not in ("", ".")]
        if ".." in parts or any("\0" in part or "\\" in part for part in parts):
            raise PermissionError(path)
        return self._check(self._folder.joinpath(*parts).resolve())

    def _file(self, path: str) -> Path:
        found = self._find(path)
        if not found.exists():
            raise FileNotFoundError(path)
        if not found.is_file():
            raise PermissionError(path)
        return found

    def _check(self, real: Path) -> Path:
        if not real.is_relative_to(self._folder):
            raise PermissionError("outside the folder")
        return real

    def _may_write(self, bytes_needed: int) -> None:
        if not self._is_writable or bytes_needed > self._most_bytes:
            raise PermissionError("read only" if not self._is_writable else "too large")
