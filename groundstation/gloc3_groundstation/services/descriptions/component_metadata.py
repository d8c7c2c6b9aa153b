"""Parameter descriptions from the vehicle itself: MAVLink's component metadata, over MAVLink FTP, checked and cached.

The vehicle names a general file and its CRC-32 in COMPONENT_METADATA, older firmware in COMPONENT_INFORMATION. The
general file names the file of the parameters (mavlink.io, "Component Metadata Protocol").
"""

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, Never

import msgspec

from gloc3.documents.characters import first_steering
from gloc3.errors import UNREADABLE, Finding, InputError, Refused
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.files.ftp import checksum
from gloc3.mavlink.services.interval import REQUEST_MESSAGE
from gloc3.store import replace_file
from gloc3_groundstation.services.descriptions.parameter_info import Infos, read_infos, unpack
from gloc3_groundstation.services.files import FileService
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.progress import OnProgress

ANSWER_S: Final = 5.0
"""Longest time for a vehicle to name its general file."""
_MESSAGES: Final = ("COMPONENT_METADATA", "COMPONENT_INFORMATION")
_PARAMETERS: Final = 1
"""COMP_METADATA_TYPE_PARAMETER."""
_URI: Final = re.compile(r"mftp://(?:\[;comp=(\d{1,3})\])?(.+)")


class NotOffered(Refused):
    """The vehicle does not describe its parameters."""


class MetadataFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file that a vehicle offers."""

    owner: Address
    """Whose file it is; a component may name one of another component of its vehicle."""
    path: str
    crc: int = 0
    """CRC-32 of the file as it is stored; 0 where the vehicle does not tell it."""


class _Entry(msgspec.Struct, rename="camel"):
    type: int
    uri: str = ""
    file_crc: int = 0
    uri_fallback: str = ""
    file_crc_fallback: int = 0


class _General(msgspec.Struct, rename="camel"):
    metadata_types: list[_Entry] = []


def read_uri(uri: str, sender: Address, crc: int = 0) -> MetadataFile:
    """The file that a URI names.

    Args:
        uri: as `mftp://etc/extras/parameters.json.xz`, or with `[;comp=191]` before the path.
        sender: whose files they are where the URI does not say.
        crc: of the file.

    Raises:
        Refused: it does not lead to the vehicle.
    """
    if first_steering(uri):
        raise Refused("the vehicle names a file of its description with control characters in it")
    found = _URI.fullmatch(uri)
    if found is None or int(found[1] or 0) > 255:
        raise Refused(f"the vehicle's description is at {uri!r}, and only files on the vehicle (mftp://) are read")
    owner = sender if found[1] is None else Address(sender.system, int(found[1]))
    return MetadataFile(owner=owner, path=found[2], crc=crc)


def read_general(data: bytes, general: MetadataFile) -> MetadataFile:
    """The file of the parameters that a general file names.

    Raises:
        InputError: it is no general file.
        NotOffered: it names no file of parameters.
        Refused: that file is not on the vehicle.
    """
    try:
        read = msgspec.json.decode(unpack(data, general.path), type=_General)
    except UNREADABLE as error:
        message = f"it is no general file of component metadata: {error}"
        raise InputError([Finding(file=general.path, message=message)]) from error
    found = [entry for entry in read.metadata_types if entry.type == _PARAMETERS]
    if not found:
        raise NotOffered("the vehicle's component metadata does not describe its parameters")
    with suppress(Refused):
        return read_uri(found[0].uri, general.owner, found[0].file_crc)
    return read_uri(found[0].uri_fallback or found[0].uri, general.owner, found[0].file_crc_fallback)


class MetadataClient(Microservice[Never]):
    """Receives where a vehicle's general file is."""

    handles = frozenset(_MESSAGES)

    def __init__(self, own: Address, target: Address) -> None:
        super().__init__(own)
        self.named: tuple[str, int] | None = None
        """URI of the general file, and its CRC-32; None until it was received."""
        self._target = target

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Keeps what the vehicle names."""
        if sender != self._target:
            return
        if message.name == "COMPONENT_METADATA":
            self.named = message.uri, message.file_crc
        else:
            self.named = message.general_metadata_uri, message.general_metadata_file_crc


class DescriptionCache:
    """Files of vehicles by their CRC-32, so that the same description is fetched only once.

    Args:
        folder: on disk, also for later sessions; None for this session only.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._kept: dict[int, bytes] = {}

    def find(self, crc: int) -> bytes | None:
        """A file of this CRC-32, if it is here whole."""
        data = self._kept.get(crc)
        if data is None and self._folder is not None:
            with suppress(OSError):
                data = self._path(self._folder, crc).read_bytes()
        return data if data is not None and checksum([data]) == crc else None

    def keep(self, crc: int, data: bytes) -> None:
        """Keeps a file; a disk that is full or read-only only costs the next session time."""
        self._kept[crc] = data
        if self._folder is not None:
            with suppress(OSError):
                self._folder.mkdir(parents=True, exist_ok=True)
                replace_file(self._path(self._folder, crc), data)

    @staticmethod
    def _path(folder: Path, crc: int) -> Path:
        return folder / f"{crc:08x}"


class MetadataService:
    """Reads a vehicle's descriptions of itself.

    Args:
        machines: run the services.
        commands: asks the vehicle.
        client: receives its answer.
        target: its autopilot.
        files: gives the files of a component.
        cache: keeps them.
    """

    def __init__(
        self,
        machines: Machines,
        commands: MavCommandClient,
        client: MetadataClient,
        target: Address,
        *,
        files: Callable[[Address], FileService],
        cache: DescriptionCache,
    ) -> None:
        self._machines, self._commands, self._client, self._target = machines, commands, client, target
        self._files, self._cache = files, cache

    async def parameters(self, on_progress: OnProgress | None = None) -> Infos:
        """The vehicle's description of its parameters.

        Raises:
            NotOffered: it has none.
            Refused: it has none that can be read; with the reason.
            InputError: its description is invalid.
        """
        for name in _MESSAGES:
            named = await self._request(name)
            if named is not None:
                general = read_uri(named[0], self._target, named[1])
                found = read_general(await self._read(general, on_progress), general)
                return read_infos(await self._read(found, on_progress), found.path)
        raise NotOffered("the vehicle offers no component metadata")

    async def _request(self, name: str) -> tuple[str, int] | None:
        """Asks for a message, and waits for it or for a refusal."""
        self._client.named = None
        machines = self._machines
        params = (float(codec.shape(name).id),)
        call = self._commands.send_long(self._target, REQUEST_MESSAGE, params, now_s=machines.now_s)
        ends_s = machines.now_s + ANSWER_S
        timer = machines.loop.call_at(ends_s, machines.settle)

        def is_over() -> bool:
            is_refused = call.result not in (None, CommandResult.ACCEPTED)
            return self._client.named is not None or is_refused or machines.now_s >= ends_s

        try:
            await machines.until(is_over)
        finally:
            timer.cancel()
            self._commands.abandon(call)
        return self._client.named

    async def _read(self, file: MetadataFile, on_progress: OnProgress | None) -> bytes:
        data = self._cache.find(file.crc) if file.crc else None
        if data is None:
            data = await self._files(file.owner).read(file.path, on_progress)
            if file.crc:
                if (crc := checksum([data])) != file.crc:
                    difference = f"its CRC-32 is {crc:08x}, and the vehicle says {file.crc:08x}"
                    raise Refused(f"{file.path} is damaged: {difference}; fetch it again")
                self._cache.keep(file.crc, data)
        return data
