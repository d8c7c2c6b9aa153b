"""The files shared over MAVLink FTP: missions to read and write, logs and pictures to read, and metadata.

Nothing else of the onboard computer's folder is served, neither its journal nor its restart state.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from gloc3.mavlink.services.files.ftp import FolderEntry
from gloc3.mavlink.services.files.ftp_files import Files, FolderFiles
from gloc3.mission.formats import MISSION_SUFFIXES, is_plan_file
from gloc3_onboard.command_server.log_shelf import LOG_NAME

MISSIONS: Final = "missions"
LOGS: Final = "logs"
ALIASES: Final = {"@MAV_LOG": LOGS}
"""MAVLink's name for the folder of logs, wherever it is."""
LARGEST_MISSION_BYTES: Final = 1 << 20
MOST_MISSIONS: Final = 200
_MISSION: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}")
_LOG: Final = re.compile(rf"{LOG_NAME.pattern}|images(-[a-z0-9_-]+)?")


def shared_files(folder: Path, logs: Path, metadata: Mapping[str, bytes]) -> Files:
    """What is shared of the onboard process's folders; the folder of missions is made.

    Raises:
        OSError: it cannot be.
    """
    missions = folder / MISSIONS
    missions.mkdir(parents=True, exist_ok=True)
    folders: dict[str, Files] = {
        LOGS: LogFolder(logs, is_writable=False),
        "metadata": MemoryFiles(metadata),
        MISSIONS: MissionFolder(missions, most_bytes=LARGEST_MISSION_BYTES),
    }
    return Folders(folders)


class Folders:
    """Several file trees, each in its own folder below the root."""

    def __init__(self, folders: Mapping[str, Files]) -> None:
        self._folders = folders

    def entries(self, path: str) -> list[FolderEntry]:
        """What a folder holds, sorted."""
        parts = _parts(path)
        if not parts:
            return [FolderEntry(name, True) for name in sorted(self._folders)]
        return self._in(parts).entries(_remainder(parts))

    def size(self, path: str) -> int:
        """Of a file, in bytes."""
        return self._in(parts := _parts(path)).size(_remainder(parts))

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Bytes of a file."""
        return self._in(parts := _parts(path)).read(_remainder(parts), offset, size)

    def create(self, path: str) -> None:
        """Makes an empty file, or empties one."""
        self._in(parts := _parts(path)).create(_remainder(parts))

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Writes into an existing file."""
        self._in(parts := _parts(path)).write(_remainder(parts), offset, data)

    def truncate(self, path: str, size: int) -> None:
        """Cuts a file off, or fills it up with zeros."""
        self._in(parts := _parts(path)).truncate(_remainder(parts), size)

    def remove(self, path: str) -> None:
        """Removes a file."""
        self._in(parts := _parts(path)).remove(_remainder(parts))

    def make_folder(self, path: str) -> None:
        """Makes a folder."""
        self._in(parts := _parts(path)).make_folder(_remainder(parts))

    def remove_folder(self, path: str) -> None:
        """Removes an empty folder."""
        self._in(parts := _parts(path)).remove_folder(_remainder(parts))

    def rename(self, path: str, new_path: str) -> None:
        """Moves a file within its folder."""
        parts, new = _parts(path), _parts(new_path)
        if parts[:1] != new[:1]:
            raise PermissionError(new_path)
        self._in(parts).rename(_remainder(parts), _remainder(new))

    def _in(self, parts: list[str]) -> Files:
        """The tree in which a path lies.

        Raises:
            OSError: there is none, or the path is the top, which is no file.
        """
        if not parts:
            raise PermissionError("the top folder")
        found = self._folders.get(parts[0])
        if found is None:
            raise FileNotFoundError(parts[0])
        return found


class MissionFolder(FolderFiles):
    """One folder of mission files: no folders in it, names that name missions, and not too many."""

    def entries(self, path: str) -> list[FolderEntry]:
        """What the folder holds, sorted."""
        return [entry for entry in super().entries(path) if not entry.is_folder]

    def create(self, path: str) -> None:
        """Makes an empty file, or empties one."""
        name = self._name(path)
        known = [entry.name for entry in self.entries("/")]
        if name not in known and len(known) >= MOST_MISSIONS:
            raise PermissionError(f"there are {MOST_MISSIONS} missions already")
        super().create(path)

    def make_folder(self, path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def remove_folder(self, path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def rename(self, path: str, new_path: str) -> None:
        """Gives a mission another name, which nothing else has."""
        self._name(new_path)
        super().rename(path, new_path)

    @staticmethod
    def _name(path: str) -> str:
        """The name in a path.

        Raises:
            PermissionError: no mission may be called that.
        """
        name = path.strip("/")
        is_known = Path(name).suffix in MISSION_SUFFIXES or is_plan_file(Path(name))
        if not is_known or not _MISSION.fullmatch(name):
            raise PermissionError(f"{name!r} is not a mission file name")
        return name


class LogFolder(FolderFiles):
    """The logs in the onboard process's folder, and the pictures beside them; made so that they cannot be written."""

    def entries(self, path: str) -> list[FolderEntry]:
        """What a folder holds, sorted."""
        if not _parts(path):
            return [entry for entry in super().entries("/") if _LOG.fullmatch(entry.name)]
        return super().entries(self._seen(path))

    def size(self, path: str) -> int:
        """Of a file, in bytes."""
        return super().size(self._seen(path))

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Bytes of a file."""
        return super().read(self._seen(path), offset, size)

    @staticmethod
    def _seen(path: str) -> str:
        """The path.

        Raises:
            FileNotFoundError: it leads to something that is not shared.
        """
        parts = _parts(path)
        if not parts or not _LOG.fullmatch(parts[0]):
            raise FileNotFoundError(path)
        return path


class MemoryFiles:
    """A few files in memory."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files

    def entries(self, path: str) -> list[FolderEntry]:
        """What the folder holds, sorted."""
        if _parts(path):
            raise FileNotFoundError(path)
        return [FolderEntry(name, False, len(data)) for name, data in sorted(self._files.items())]

    def size(self, path: str) -> int:
        """Of a file, in bytes."""
        return len(self._data(path))

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Bytes of a file."""
        return self._data(path)[offset : offset + size]

    def create(self, path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Refuses."""
        raise PermissionError(path)

    def truncate(self, path: str, size: int) -> None:
        """Refuses."""
        raise PermissionError(path)

    def remove(self, path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def make_folder(self, path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def remove_folder(self, path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def rename(self, path: str, new_path: str) -> None:
        """Refuses."""
        raise PermissionError(path)

    def _data(self, path: str) -> bytes:
        found = self._files.get("/".join(_parts(path)))
        if found is None:
            raise FileNotFoundError(path)
        return found


def _parts(path: str) -> list[str]:
    """The names in a path, the first one without its alias.

    Raises:
        PermissionError: it leads upwards.
    """
    parts = [part for part in path.split("/") if part not in ("", ".")]
    if ".." in parts or "\0" in path:
        raise PermissionError(path)
    return [ALIASES.get(parts[0], parts[0]), *parts[1:]] if parts else []


def _remainder(parts: list[str]) -> str:
    return "/" + "/".join(parts[1:])
