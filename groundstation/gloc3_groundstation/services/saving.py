"""A file that is being downloaded: parts of it are kept beside it, and it takes its name when it is whole."""

from pathlib import Path
from typing import Final

from gloc3.errors import Refused

PART_SUFFIX: Final = ".part"


class Saving:
    """Where a download goes.

    Args:
        path: the file that it becomes.
        identity: tells one version of what is downloaded from another; parts of another one are not used.

    Raises:
        Refused: there is no folder for it.
    """

    def __init__(self, path: Path, identity: str = "") -> None:
        self.path: Final = path
        self.part: Final = path.with_name(f"{path.name}{'.' if identity else ''}{identity}{PART_SUFFIX}")
        self._kept = 0
        if not path.parent.is_dir():
            raise Refused(f"there is no folder {path.parent}")
        if path.is_dir():
            raise Refused(f"{path} is a folder")

    def begun(self) -> bytes:
        """What an earlier attempt has left of it."""
        try:
            data = self.part.read_bytes()
        except OSError:
            return b""
        self._kept = len(data)
        return data

    def keep(self, data: bytes | bytearray, whole_bytes: int) -> None:
        """Adds what has come since the last time.

        Args:
            data: all that is here, from the beginning.
            whole_bytes: how much of it has no holes.

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
        """The file is whole: it takes its name.

        Raises:
            Refused: it cannot be written.
        """
        try:
            self.part.write_bytes(data)
            self.part.replace(self.path)
        except OSError as error:
            raise Refused(f"{self.path} cannot be written: {error.strerror or error}") from error
