"""The simulated autopilot's SD card: files and flight logs, kept in memory."""

from collections.abc import Callable
from errno import EEXIST, ENOENT, ENOSPC, ENOTEMPTY, EPERM
from os import strerror
from typing import Final

from gloc3.mavlink.services.files.ftp import FolderEntry
from gloc3_sitl.autopilot.logs.flight_log import FlightLogger

_MOST_BYTES: Final = 4_000_000
"""Capacity for files written from outside."""
_MOST_FILES: Final = 200


class OnboardFiles:
    """A file tree in memory. One folder holds the flight logs, which can be read and removed, but not written.

    Args:
        logger: source of the flight logs.
        log_folder: folder of the flight logs in this style, such as `/fs/microsd/log`.
    """

    def __init__(self, logger: FlightLogger, log_folder: str) -> None:
        self._logger = logger
        self._log_folder = _parts(log_folder)
        self._files: dict[tuple[str, ...], bytearray] = {}
        self._served: dict[tuple[str, ...], tuple[Callable[[], bytes], Callable[[], int]]] = {}
        self._queried: dict[tuple[str, ...], Callable[[str], bytes]] = {}
        """What makes a served file for a query behind its path."""
        self._opened: dict[tuple[str, ...], bytes] = {}
        """Served files as they were when their size was last requested, by path and query."""
        self._folders: dict[tuple[str, ...], None] = {(): None}
        for depth in range(1, len(self._log_folder) + 1):
            self._folders[self._log_folder[:depth]] = None

    def serve(
        self,
        path: str,
        content: Callable[[], bytes],
        size: Callable[[], int] | None = None,
        queried: Callable[[str], bytes] | None = None,
    ) -> None:
        """Adds a file that cannot be changed, made anew whenever it is opened.

        Args:
            path: of the file.
            content: makes it.
            size: bytes that are reported for it, where they are not those of its content.
            queried: makes it for what stands behind a `?` in the path; None where nothing may stand there.
        """
        parts = _parts(path)
        self._served[parts] = (content, (lambda: len(content())) if size is None else size)
        if queried is not None:
            self._queried[parts] = queried
        for depth in range(1, len(parts)):
            self._folders[parts[:depth]] = None

    def load(self, other: "OnboardFiles") -> None:
        """Keeps the files of the same memory card."""
        self._files, self._folders = other._files, other._folders | self._folders

    def entries(self, path: str) -> list[FolderEntry]:
        """What a folder holds, sorted."""
        folder = self._folder(path)
        found = [FolderEntry(other[-1], True) for other in self._folders if other and other[:-1] == folder]
        found += [
            FolderEntry(other[-1], False, len(data)) for other, data in self._files.items() if other[:-1] == folder
        ]
        found += [
            FolderEntry(other[-1], False, size()) for other, (_, size) in self._served.items() if other[:-1] == folder
        ]
        if folder == self._log_folder:
            found += [FolderEntry(log.name, False, len(log.data)) for log in self._logger.logs]
        return sorted(found, key=lambda entry: entry.name)

    def size(self, path: str) -> int:
        """Of a file, in bytes."""
        parts = _parts(path)
        asked, _, query = path.partition("?")
        if query and (queried := self._queried.get(_parts(asked))) is not None:
            self._opened[parts] = queried(query)
            return self._served[_parts(asked)][1]()
        if parts in self._served:
            content, size = self._served[parts]
            self._opened[parts] = content()
            return size()
        return len(self._data(path))

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Bytes of a file; fewer or none behind its end."""
        opened = self._opened.get(_parts(path))
        if opened is not None:
            return opened[offset : offset + size]
        return bytes(self._data(path)[offset : offset + size])

    def create(self, path: str) -> None:
        """Makes an empty file, or empties one."""
        parts = _parts(path)
        if parts in self._folders or parts in self._served or parts[:-1] == self._log_folder:
            raise _error(EPERM, path)
        if parts[:-1] not in self._folders:
            raise _error(ENOENT, path)
        if len(self._files) >= _MOST_FILES:
            raise _error(ENOSPC, path)
        self._files[parts] = bytearray()

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Writes into an existing file."""
        file = self._writable(path)
        self._make_room(file, offset + len(data), path)
        file[offset : offset + len(data)] = data

    def truncate(self, path: str, size: int) -> None:
        """Cuts a file off, or fills it up with zeros."""
        file = self._writable(path)
        self._make_room(file, size, path)
        del file[size:]

    def remove(self, path: str) -> None:
        """Removes a file."""
        log = self._log(path)
        if log is not None:
            self._logger.remove(log)
            return
        if self._files.pop(_parts(path), None) is None:
            raise _error(ENOENT, path)

    def make_folder(self, path: str) -> None:
        """Makes a folder."""
        parts = _parts(path)
        if parts in self._folders or parts in self._files:
            raise _error(EEXIST, path)
        if parts[:-1] not in self._folders:
            raise _error(ENOENT, path)
        if len(self._folders) >= _MOST_FILES:
            raise _error(ENOSPC, path)
        self._folders[parts] = None

    def remove_folder(self, path: str) -> None:
        """Removes an empty folder."""
        parts = self._folder(path)
        if parts == self._log_folder[: len(parts)]:
            raise _error(EPERM, path)
        if self.entries(path):
            raise _error(ENOTEMPTY, path)
        del self._folders[parts]

    def rename(self, path: str, new_path: str) -> None:
        """Moves a file; never over an existing one. Folders stay where they are."""
        parts, new_parts = _parts(path), _parts(new_path)
        if parts in self._folders or new_parts[:-1] == self._log_folder:
            raise _error(EPERM, path)
        if new_parts in self._files or new_parts in self._folders or new_parts in self._served:
            raise _error(EEXIST, new_path)
        if parts not in self._files or new_parts[:-1] not in self._folders:
            raise _error(ENOENT, path)
        self._files[new_parts] = self._files.pop(parts)

    def _folder(self, path: str) -> tuple[str, ...]:
        parts = _parts(path)
        if parts not in self._folders:
            raise _error(ENOENT, path)
        return parts

    def _log(self, path: str) -> int | None:
        """Number of the flight log that a path names."""
        parts = _parts(path)
        if not parts or parts[:-1] != self._log_folder:
            return None
        return next((log.number for log in self._logger.logs if log.name == parts[-1]), None)

    def _data(self, path: str) -> bytearray:
        number = self._log(path)
        if number is not None:
            return next(log.data for log in self._logger.logs if log.number == number)
        parts = _parts(path)
        if parts in self._folders:
            raise _error(EPERM, path)
        if parts not in self._files:
            raise _error(ENOENT, path)
        return self._files[parts]

    def _writable(self, path: str) -> bytearray:
        if self._log(path) is not None or _parts(path) in self._served:
            raise _error(EPERM, path)
        return self._data(path)

    def _make_room(self, file: bytearray, size: int, path: str) -> None:
        """Fills a file up to a size, if there is room."""
        grows = size - len(file)
        if grows > 0:
            if sum(map(len, self._files.values())) + grows > _MOST_BYTES:
                raise _error(ENOSPC, path)
            file.extend(bytes(grows))


def _parts(path: str) -> tuple[str, ...]:
    parts = tuple(part for part in path.split("/") if part not in ("", "."))
    if ".." in parts or "\0" in path:
        raise _error(EPERM, path)
    return parts


def _error(number: int, path: str) -> OSError:
    return OSError(number, strerror(number), path)
