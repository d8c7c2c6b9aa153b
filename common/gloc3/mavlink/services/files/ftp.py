"""MAVLink FTP on the wire: the payload, its operations and errors, directory entries and the checksum."""

from __future__ import annotations

import errno
import struct
import zlib
from collections.abc import Iterable
from enum import IntEnum
from typing import Final

import msgspec

DATA_BYTES: Final = 239
_HEADER: Final = struct.Struct("<HBBBBBxI")


class Operation(IntEnum):
    """Operations of requests, and results of replies."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_READ_ONLY = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WRITE_ONLY = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALCULATE_CRC32 = 14
    BURST_READ_FILE = 15
    ACKNOWLEDGED = 128
    REFUSED = 129


class FtpError(IntEnum):
    """Reasons for a failed operation: the protocol's numbers, and ends that have none."""

    NONE = 0
    FAILED = 1
    FAILED_WITH_NUMBER = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10
    TOO_LARGE = 251
    """It does not go into memory."""
    DIFFERENT = 252
    """The written data and the file on the vehicle differ."""
    CANCELLED = 253
    TOO_MANY_LOSSES = 254
    NO_ANSWER = 255

    @property
    def words(self) -> str:
        """For a person."""
        return _WORDS.get(self, self.name.lower().replace("_", " "))

    @classmethod
    def read(cls, data: bytes) -> FtpError:
        """The error in the data of a refusal."""
        number = data[0] if data else cls.FAILED
        return cls(number) if number <= cls.FILE_NOT_FOUND else cls.FAILED


_WORDS: Final = {
    FtpError.FAILED_WITH_NUMBER: "failed in the other end's file system",
    FtpError.INVALID_SESSION: "the server has closed the session",
    FtpError.NO_SESSIONS_AVAILABLE: "the other end has no session left",
    FtpError.UNKNOWN_COMMAND: "the other end does not know this operation",
    FtpError.FILE_EXISTS: "it exists already",
    FtpError.FILE_PROTECTED: "it must not be touched",
    FtpError.FILE_NOT_FOUND: "there is no such file or folder",
    FtpError.TOO_LARGE: "it is too large to be read at once",
    FtpError.DIFFERENT: "the file differs from what was written",
    FtpError.TOO_MANY_LOSSES: "gave up after repeated packet loss",
}


def error_data(error: OSError) -> bytes:
    """What a refusal says about an error of the file system."""
    match error:
        case FileNotFoundError() | NotADirectoryError():
            return bytes([FtpError.FILE_NOT_FOUND])
        case FileExistsError():
            return bytes([FtpError.FILE_EXISTS])
        case PermissionError() | IsADirectoryError():
            return bytes([FtpError.FILE_PROTECTED])
        case _:
            return bytes([FtpError.FAILED_WITH_NUMBER, (error.errno or errno.EIO) & 0xFF])


class Payload(msgspec.Struct, frozen=True, kw_only=True):
    """The content of one FILE_TRANSFER_PROTOCOL message."""

    sequence: int = 0
    """16 bits; an answer has that of its question plus one."""
    session: int = 0
    operation: int
    size: int = 0
    """Bytes of data, or how many are wanted."""
    requested: int = 0
    """In an answer, the requested operation."""
    is_burst_complete: bool = False
    offset: int = 0
    data: bytes = b""

    def encode(self) -> bytes:
        """As the message's payload."""
        header = _HEADER.pack(
            self.sequence & 0xFFFF,
            self.session,
            self.operation,
            self.size,
            self.requested,
            self.is_burst_complete,
            self.offset & 0xFFFF_FFFF,
        )
        return header + self.data


def read_payload(raw: bytes) -> Payload | None:
    """The payload in a message; None if it contradicts itself."""
    sequence, session, operation, size, requested, is_complete, offset = _HEADER.unpack_from(raw)
    if size > DATA_BYTES:
        return None
    return Payload(
        sequence=sequence,
        session=session,
        operation=operation,
        size=size,
        requested=requested,
        is_burst_complete=is_complete != 0,
        offset=offset,
        data=raw[_HEADER.size : _HEADER.size + size],
    )


class FolderEntry(msgspec.Struct, frozen=True, order=True):
    """An entry of a folder."""

    name: str
    is_folder: bool
    size: int = 0
    """Bytes; 0 for a folder."""

    def encode(self) -> bytes:
        """As the protocol lists it."""
        name = self.name.encode("utf-8", "surrogateescape")
        return b"D%b\0" % name if self.is_folder else b"F%b\t%d\0" % (name, self.size)


def read_entries(data: bytes) -> tuple[list[FolderEntry], int]:
    """The entries in an answer, and how many it counts; those that are skipped or not understood count too."""
    found, count = [], 0
    for raw in data.split(b"\0"):
        if not raw:
            continue
        count += 1
        kind, text = raw[:1], raw[1:].decode("utf-8", "replace")
        if kind == b"D" and text not in (".", ".."):
            found.append(FolderEntry(text.partition("\t")[0], True))
        elif kind == b"F":
            name, _, size = text.partition("\t")
            found.append(FolderEntry(name, False, int(size) if size.isascii() and size.isdigit() else 0))
    return found, count


class Checksum:
    """The protocol's CRC-32: the usual polynomial, with initial value 0 and not inverted."""

    def __init__(self) -> None:
        self._crc = 0xFFFF_FFFF

    def add(self, piece: bytes) -> None:
        """Takes more in."""
        self._crc = zlib.crc32(piece, self._crc)

    @property
    def value(self) -> int:
        """Of all data so far."""
        return self._crc ^ 0xFFFF_FFFF


def checksum(pieces: Iterable[bytes]) -> int:
    """The protocol's CRC-32 of some pieces."""
    crc = Checksum()
    for piece in pieces:
        crc.add(piece)
    return crc.value
