"""NTRIP, the protocol of casters, versions 1 and 2: requests, answers and source tables, without I/O.

RTCM 10410.0 and 10410.1. One request serves both: a caster of version 1 answers `ICY 200 OK` to a request of version 2.
"""

from base64 import b64encode
from enum import StrEnum
from typing import Final

import msgspec

from gloc3 import __version__
from gloc3.clock import utc_text
from gloc3.errors import Refused, nearest
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.corrections.source_url import SourceUrl

MOST_HEAD_BYTES: Final = 16_384
MOST_TABLE_BYTES: Final = 262_144
MOST_CHUNK_BYTES: Final = 1 << 20
MOST_NAMES: Final = 12
MOST_ANSWER: Final = 80
"""Characters of a caster's answer that are shown."""
END_OF_TABLE: Final = b"ENDSOURCETABLE"
BEGINNINGS: Final = (b"HTTP/", b"ICY ", b"SOURCETABLE ", b"ERROR")
"""Of the answers of casters."""
_NAME_AT, _NMEA_AT = 1, 11


class Mountpoint(msgspec.Struct, frozen=True):
    """One line of a source table."""

    name: str
    wants_position: bool
    """Whether it computes corrections for the receiver's position, which is sent to it as GGA."""


class ReplyKind(StrEnum):
    """What a caster sends."""

    DATA = "data"
    TABLE = "table"


class OldCaster(Refused):
    """The caster does not understand the request, which should be repeated in version 1."""


def request(source: SourceUrl, mountpoint: str, *, version: int = 2, position: str = "") -> bytes:
    """The request for a mountpoint, or for the source table.

    Args:
        source: the caster, with user and password.
        mountpoint: its name; empty for the source table.
        version: of NTRIP.
        position: a GGA sentence for a mountpoint that wants one; empty without.
    """
    lines = [f"GET /{mountpoint} HTTP/{'1.1' if version == 2 else '1.0'}", f"User-Agent: NTRIP gloc3/{__version__}"]
    if version == 2:
        host = f"[{source.host}]" if ":" in source.host else source.host
        lines += [f"Host: {host}:{source.port}", "Ntrip-Version: Ntrip/2.0", "Connection: close"]
        if position:
            lines.append(f"Ntrip-GGA: {position.strip()}")
    if source.user or source.password:
        lines.append(f"Authorization: Basic {b64encode(f'{source.user}:{source.password}'.encode()).decode()}")
    return "\r\n".join([*lines, "", ""]).encode()


def gga(place: GeoPoint, utc_s: float) -> str:
    """A GGA sentence for a position, which is taken for one of plain satellites (NMEA 0183).

    Args:
        place: the position; its altitude counts as one above mean sea level.
        utc_s: seconds since 1970.
    """
    latitude, longitude = abs(place.latitude_deg), abs(place.longitude_deg)
    north, east = "N" if place.latitude_deg >= 0.0 else "S", "E" if place.longitude_deg >= 0.0 else "W"
    body = (
        f"GPGGA,{utc_text(utc_s, '%H%M%S')}.00,{_minutes(latitude, 2)},{north},"
        f"{_minutes(longitude, 3)},{east},1,12,1.0,{place.altitude_m:.1f},M,0.0,M,,"
    )
    check = 0
    for character in body:
        check ^= ord(character)
    return f"${body}*{check:02X}\r\n"


def _minutes(angle_deg: float, digits: int) -> str:
    """Degrees and minutes: 48.5 is `4830.0000`."""
    whole, part = divmod(round(angle_deg * 600_000.0), 600_000)
    return f"{whole:0{digits}d}{part / 10_000.0:07.4f}"


def read_table(data: bytes) -> dict[str, Mountpoint]:
    """The mountpoints of a source table, by name."""
    found = {}
    for line in data.decode("utf-8", "replace").splitlines():
        fields = line.split(";")
        if fields[0] == "STR" and len(fields) > _NAME_AT and fields[_NAME_AT].isprintable():
            wants_position = len(fields) > _NMEA_AT and fields[_NMEA_AT].strip() == "1"
            found[fields[_NAME_AT]] = Mountpoint(fields[_NAME_AT], wants_position)
    return found


def unknown_mountpoint(source: SourceUrl, table: dict[str, Mountpoint]) -> Refused:
    """The error for a mountpoint that the caster does not have, with those that it has."""
    which = f"no mountpoint {source.mountpoint!r}" if source.mountpoint else "a mountpoint has to be named"
    if not table:
        return Refused(f"{which} at {source.host}, and the caster lists none")
    near = nearest(source.mountpoint, tuple(table)) if source.mountpoint else ""
    hint = f"; {near}" if near.endswith("?") else "."
    more = f" and {len(table) - MOST_NAMES} more" if len(table) > MOST_NAMES else ""
    return Refused(f"{which} at {source.host}{hint} It has {', '.join(list(table)[:MOST_NAMES])}{more}")


class NtripReply:
    """The answer of a caster, as its bytes come.

    Args:
        source: the caster, for errors.
        table: its mountpoints, for errors; empty where they are not known.
    """

    def __init__(self, source: SourceUrl, table: dict[str, Mountpoint] | None = None) -> None:
        self.kind: ReplyKind | None = None
        """None until the head of the answer is complete."""
        self._source, self._table = source, table or {}
        self._head = bytearray()
        self._chunks: ChunkParser | None = None

    def receive(self, data: bytes) -> bytes:
        """Takes bytes; returns those of the corrections or of the table.

        Raises:
            OldCaster: the request is not understood.
            Refused: the caster refuses, or answers in another protocol.
        """
        if self.kind is not None:
            return self._body(data)
        self._head += data
        first, found, rest = bytes(self._head).partition(b"\r\n")
        if found and first.startswith(b"ICY 200"):
            self.kind = ReplyKind.DATA
            return self._body(rest)
        head, found, rest = bytes(self._head).partition(b"\r\n\r\n")
        is_error = len(first) < len(self._head) and first.startswith(b"ERROR")
        if not found and not is_error:
            is_known = any(one.startswith(self._head[: len(one)]) for one in BEGINNINGS)
            if not is_known or len(self._head) > MOST_HEAD_BYTES:
                raise OldCaster(f"{self._source.host} does not answer as an NTRIP caster")
            return b""
        self.kind = self._kind_of(first.decode("latin-1"), _headers(head))
        return self._body(rest)

    def _kind_of(self, status: str, headers: dict[str, str]) -> ReplyKind:
        if status.startswith("SOURCETABLE 200"):
            return ReplyKind.TABLE
        protocol, _, rest = status.partition(" ")
        if not protocol.startswith("HTTP/") or not rest.startswith("200"):
            raise self._refusal(status, rest[:3])
        if "chunked" in headers.get("transfer-encoding", "").lower():
            self._chunks = ChunkParser()
        return ReplyKind.TABLE if "sourcetable" in headers.get("content-type", "").lower() else ReplyKind.DATA

    def _refusal(self, status: str, code: str) -> Refused:
        source = self._source
        if code == "401" or "password" in status.lower():
            if source.user:
                return Refused(f"{source.host} refuses the user or the password for {source.mountpoint!r} (401)")
            return Refused(
                f"{source.host} asks for a user and a password (401): {source.scheme}://USER:PASSWORD@HOST/MOUNTPOINT"
            )
        if code == "404":
            return unknown_mountpoint(source, self._table)
        words = "".join(one for one in status if one.isprintable())[:MOST_ANSWER]
        if code in ("400", "501", "505"):
            return OldCaster(f"{source.host} answers {words!r}")
        return Refused(f"{source.host} answers {words!r}")

    def _body(self, data: bytes) -> bytes:
        return data if self._chunks is None else self._chunks.receive(data)


def _headers(head: bytes) -> dict[str, str]:
    pairs = (line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:])
    return {name.strip().lower(): value.strip() for name, _, value in pairs}


class ChunkParser:
    """The body of an answer that comes in chunks (RFC 9112, 7.1)."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._left = 0
        """Bytes of the present chunk that have not come, the line break behind it included."""

    def receive(self, data: bytes) -> bytes:
        """Takes bytes; returns those of the body.

        Raises:
            Refused: a chunk has no length.
        """
        self._data += data
        body = b""
        while self._data:
            if self._left:
                taken = bytes(self._data[: self._left])
                del self._data[: len(taken)]
                body += taken[: max(0, self._left - 2)]
                self._left -= len(taken)
                continue
            line, found, _ = bytes(self._data).partition(b"\r\n")
            if not found and len(self._data) < MOST_ANSWER:
                break
            length = line.partition(b";")[0].strip()
            try:
                size = int(length, 16)
            except ValueError:
                size = -1
            if not found or not 0 <= size <= MOST_CHUNK_BYTES:
                raise Refused("the caster's answer is damaged: a chunk without a length")
            del self._data[: len(line) + 2]
            self._left = size + 2
        return body
