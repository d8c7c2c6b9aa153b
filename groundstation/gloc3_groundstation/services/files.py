"""Files of a vehicle over MAVLink FTP: list, download, upload, remove, folders.

They go through our own file transfer, not MAVSDK's: a download there cannot be cancelled, and with one frame in ten
lost a file of 200 kB took it more than 50 s where ours takes 7 (measured with 4.1).
"""

from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.ftp import FolderEntry, FtpError, checksum
from gloc3.mavlink.services.files.ftp_client import FtpCall, FtpClient
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.progress import OnProgress, Quietly
from gloc3_groundstation.services.saving import PartFile

LARGEST_UPLOAD_BYTES: Final = 64_000_000


class Folder(msgspec.Struct, frozen=True, kw_only=True):
    """Contents of a folder on the vehicle."""

    path: str
    entries: tuple[FolderEntry, ...]
    """Folders first, then by name."""

    @property
    def parent(self) -> str:
        """Parent folder; the root is its own parent."""
        return str(PurePosixPath(self.path).parent)

    def path_of(self, entry: FolderEntry) -> str:
        """The whole path of one of the entries."""
        return str(PurePosixPath(self.path) / entry.name)


class FileService:
    """Transfers files. One transfer runs at a time, further ones wait for it.

    Args:
        machines: run the client.
        client: speaks the protocol.
        target: whose files; an autopilot, a camera, a companion.
    """

    def __init__(self, machines: Machines, client: FtpClient, target: Address) -> None:
        self._machines = machines
        self._client = client
        self._target = target

    async def list(self, path: str = "/") -> Folder:
        """Lists a folder.

        Raises:
            Refused: there is none, or no answer.
        """
        path = _absolute(path)
        call = self._client.list(self._target, path, now_s=self._machines.now_s)
        await self._finish(call, f"{path} cannot be listed")
        return Folder(path=path, entries=tuple(sorted(call.entries, key=lambda e: (not e.is_folder, e.name))))

    async def read(self, path: str, on_progress: OnProgress | None = None) -> bytes:
        """Downloads a file into memory.

        Raises:
            Refused: there is none, or no answer; with the reason.
        """
        path, report = _absolute(path), Quietly(on_progress)
        call = self._client.read(self._target, path, now_s=self._machines.now_s)

        def poll() -> None:
            report(f"downloading {path}", call.progress, _size(len(call.data)))

        await self._finish(call, f"{path} cannot be downloaded", poll)
        return bytes(call.data)

    async def download(self, path: str, to: Path, on_progress: OnProgress | None = None) -> Path:
        """Downloads a file to disk; resumes an earlier partial download.

        Args:
            path: on the vehicle.
            to: a local folder, where another file of this name stays and the new one gets a number; or the file's new
                path, where an existing file is replaced when the download is complete.
            on_progress: called with the progress.

        Returns:
            Its local path.

        Raises:
            Refused: it cannot be read or written; with the reason. A partial download is kept.
        """
        path, report = _absolute(path), Quietly(on_progress)
        is_folder = to.is_dir()
        part = PartFile(to / PurePosixPath(path).name if is_folder else to)
        call = self._client.read(self._target, path, now_s=self._machines.now_s, sink=part)

        def poll() -> None:
            report(f"downloading {path}", call.progress, _size(call.received))

        try:
            await self._finish(call, f"{path} cannot be downloaded", poll, lambda: part.problem)
        finally:
            part.close()
        if part.begun:
            report(f"comparing {path} with the vehicle's")
            await self._compare(path, part)
        part.finish(is_replacing=not is_folder)
        return part.path

    async def read_into(self, path: str, part: PartFile, on_bytes: Callable[[int], None]) -> None:
        """Downloads the missing part of a file; the caller compares and finishes it.

        Raises:
            Refused: it cannot be read; with the reason. A partial download is kept.
        """
        path = _absolute(path)
        call = self._client.read(self._target, path, now_s=self._machines.now_s, sink=part)
        await self._finish(call, f"{path} cannot be downloaded", lambda: on_bytes(call.received), lambda: part.problem)

    async def upload(self, file: Path, folder: str, on_progress: OnProgress | None = None) -> str:
        """Uploads a file into a folder of the vehicle, then compares both ends' checksums.

        Returns:
            Its path on the vehicle.

        Raises:
            Refused: it cannot be read here or written there; with the reason.
        """
        try:
            if file.stat().st_size > LARGEST_UPLOAD_BYTES:
                raise Refused(f"{file} is larger than {_size(LARGEST_UPLOAD_BYTES)}")
            data = file.read_bytes()
        except OSError as error:
            raise Refused(f"{file} cannot be read: {error.strerror or error}") from error
        path, report = _absolute(str(PurePosixPath(folder) / file.name)), Quietly(on_progress)
        call = self._client.write(self._target, path, data, now_s=self._machines.now_s)
        await self._finish(
            call,
            f"{path} cannot be written",
            lambda: report(f"uploading {file.name}", call.progress, _size(len(data))),
        )
        return path

    async def remove(self, path: str) -> None:
        """Removes a file.

        Raises:
            Refused: there is none, or it may not be removed.
        """
        path = _absolute(path)
        call = self._client.remove(self._target, path, now_s=self._machines.now_s)
        await self._finish(call, f"{path} cannot be removed")

    async def make_folder(self, path: str) -> None:
        """Makes a folder.

        Raises:
            Refused: it is there already, or may not be made.
        """
        path = _absolute(path)
        call = self._client.make_folder(self._target, path, now_s=self._machines.now_s)
        await self._finish(call, f"the folder {path} cannot be made")

    async def remove_folder(self, path: str) -> None:
        """Removes an empty folder.

        Raises:
            Refused: there is none, it is not empty, or may not be removed.
        """
        path = _absolute(path)
        call = self._client.remove_folder(self._target, path, now_s=self._machines.now_s)
        await self._finish(call, f"the folder {path} cannot be removed")

    async def rename(self, path: str, new_path: str) -> None:
        """Moves a file or folder.

        Raises:
            Refused: there is none, or it may not be moved.
        """
        path, new_path = _absolute(path), _absolute(new_path)
        call = self._client.rename(self._target, path, new_path, now_s=self._machines.now_s)
        await self._finish(call, f"{path} cannot become {new_path}")

    async def _compare(self, path: str, part: PartFile) -> None:
        """Compares checksums where the vehicle provides one: a partial download may be of another file."""
        call = self._client.calculate_checksum(self._target, path, now_s=self._machines.now_s)
        try:
            await self._machines.until(lambda: call.result is not None)
        finally:
            self._client.cancel(call, self._machines.now_s)
        loop = self._machines.loop
        if call.result is FtpError.NONE and call.checksum != await loop.run_in_executor(None, _checksum, part):
            part.discard()
            raise Refused(f"{path} has changed since its download was begun; download it again")

    async def _finish(
        self,
        call: FtpCall,
        on_error: str,
        poll: Callable[[], None] | None = None,
        problem: Callable[[], Refused | None] = lambda: None,
    ) -> None:
        try:
            await self._machines.until(lambda: call.result is not None or problem() is not None, poll)
        finally:
            if call.result is None:
                self._client.cancel(call, self._machines.now_s)
                self._machines.settle()
        found = problem()
        if found is not None:
            raise found
        if call.result is not FtpError.NONE:
            raise Refused(f"{on_error}: {call.result.words if call.result is not None else 'cancelled'}")


def _checksum(part: PartFile) -> int:
    return checksum(part.pieces())


def _absolute(path: str) -> str:
    """A path from the top, without `.` and `..`; ArduPilot's made-up files, as `@SYS/threads.txt`, have no top.

    Raises:
        Refused: it leads above the top, or holds what no path may.
    """
    if "\0" in path:
        raise Refused("a path has no zero bytes")
    parts: list[str] = []
    for part in PurePosixPath("/", path).parts[1:]:
        if part == "..":
            if not parts:
                raise Refused(f"{path} leads above the top folder")
            parts.pop()
        else:
            parts.append(part)
    top = "" if path.startswith("@") else "/"
    return top + "/".join(parts)


def _size(number: int) -> str:
    return (
        f"{number} bytes" if number < 10_000 else f"{number / 1e3:.0f} kB" if number < 1e7 else f"{number / 1e6:.1f} MB"
    )
