"""A file being downloaded: kept as a part file beside it, and renamed when complete."""

from collections.abc import Iterator
from filecmp import cmp
from itertools import count
from pathlib import Path
from typing import BinaryIO, Final

from gloc3.errors import Refused

PART_SUFFIX: Final = ".part"
_PIECE_BYTES: Final = 1 << 16


class Saving:
    """Destination of a download.

    Args:
        path: the file that it becomes; with a number, where another file has this name.
        identity: tells one version of what is downloaded from another; parts of another one are not used.

    Raises:
        Refused: there is no folder for it.
    """

    def __init__(self, path: Path, identity: str = "") -> None:
        self.path = path
        self.part: Final = path.with_name(f"{path.name}{'.' if identity else ''}{identity}{PART_SUFFIX}")
        self._kept = 0
        _check(path)

    def begun(self) -> bytes:
        """What an earlier attempt has left of it."""
        try:
            data = self.part.read_bytes()
        except OSError:
            return b""
        self._kept = len(data)
        return data

    def add(self, data: bytes | bytearray, whole_bytes: int) -> None:
        """Adds the data received since the last call.

        Args:
            data: all received data, from the start.
            whole_bytes: length of the part without gaps.

        Raises:
            Refused: it cannot be written.
        """
        if whole_bytes <= self._kept:
            return
        try:
            with self.part.open("r+b" if self.part.exists() else "wb") as file:
                file.seek(self._kept)
                file.write(data[self._kept : whole_bytes])
                file.truncate()
        except OSError as error:
            raise Refused(f"{self.part} cannot be written: {error.strerror or error}") from error
        self._kept = whole_bytes

    def finish(self, data: bytes | bytearray) -> None:
        """Renames the complete file to its final name.

        Raises:
            Refused: it cannot be written.
        """
        try:
            self.part.write_bytes(data)
            self.path = self.part.replace(_unused(self.path, self.part))
        except OSError as error:
            raise Refused(f"{self.path} cannot be written: {error.strerror or error}") from error


class PartFile:
    """A download that goes to the disk as it comes, so that files of any size need no memory; see `gloc3.mavlink.services.files.ftp_stream`.

    Args:
        path: the file that it becomes.

    Raises:
        Refused: there is no folder for it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.begun = 0
        """Bytes that an earlier attempt has left."""
        self.problem: Refused | None = None
        """Why nothing more can be written, as a full disk."""
        self._part = path.with_name(f"{path.name}{PART_SUFFIX}")
        self._file: BinaryIO | None = None
        _check(path)

    def opened(self, size: int) -> int:
        """Resumes a partial download of a file of the same size; returns its length."""
        self._part = part_of(self.path, size)
        try:
            self._file = self._part.open("ab")
            if self._file.tell() > size:
                self._file.truncate(0)
            self.begun = self._file.tell()
        except OSError as error:
            self._fail(error)
        return self.begun

    def write(self, data: bytes) -> None:
        """Writes the next bytes."""
        if self._file is None or self.problem is not None:
            return
        try:
            self._file.write(data)
        except OSError as error:
            self._fail(error)

    def close(self) -> None:
        """Keeps the partial download."""
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError as error:
                self._fail(error)

    def pieces(self) -> Iterator[bytes]:
        """All that is here, piece by piece."""
        with self._part.open("rb") as file:
            while piece := file.read(_PIECE_BYTES):
                yield piece

    def discard(self) -> None:
        """Deletes the partial download."""
        self.close()
        self._part.unlink(missing_ok=True)

    def finish(self, *, is_replacing: bool = True) -> None:
        """Renames the complete file to its final name.

        Args:
            is_replacing: whether it replaces another file of this name; if not, it gets a number.

        Raises:
            Refused: it cannot be written.
        """
        self.close()
        try:
            if self.problem is None:
                self.path = self._part.replace(self.path if is_replacing else _unused(self.path, self._part))
        except OSError as error:
            self._fail(error)
        if self.problem is not None:
            raise self.problem

    def _fail(self, error: OSError) -> None:
        self.problem = Refused(f"{self._part} cannot be written: {error.strerror or error}")


def part_of(path: Path, size: int) -> Path:
    """Path of the partial download of a file with this final size."""
    return path.with_name(f"{path.name}.{size}{PART_SUFFIX}")


def _unused(path: Path, part: Path) -> Path:
    """The path, with a number where a file of that name has other contents than the complete part: `log_001-2.ulg`."""
    free = path
    for number in count(2):
        if not free.exists() or cmp(part, free, shallow=False):
            break
        free = path.with_stem(f"{path.stem}-{number}")
    return free


def _check(path: Path) -> None:
    """Whether a download can go there.

    Raises:
        Refused: it cannot.
    """
    if not path.parent.is_dir():
        raise Refused(f"there is no folder {path.parent}")
    if path.is_dir():
        raise Refused(f"{path} is a folder")
