"""Addresses of corrections: NTRIP casters, TCP servers and serial bases; a password is never part of what is shown.

ntrip://USER:PASSWORD@HOST:2101/MOUNTPOINT    an NTRIP caster, version 1 or 2; ntrips:// with TLS, port 2102
tcp://HOST:PORT                               RTCM 3 as a stream
serial:///dev/ttyACM0:115200                  a base on a serial line that sends RTCM 3
"""

from typing import Final
from urllib.parse import unquote, urlsplit

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.endpoints import SERIAL_SCHEMES, parse_url

PORTS: Final = {"ntrip": 2101, "ntrips": 2102}
SCHEMES: Final = (*PORTS, "tcp", "serial")
EXAMPLES: Final = "ntrip://USER:PASSWORD@HOST:2101/MOUNTPOINT, tcp://HOST:PORT or serial:///dev/ttyACM0:115200"


class SourceUrl(msgspec.Struct, frozen=True, kw_only=True):
    """A source of corrections."""

    scheme: str
    shown: str
    """The address without user and password."""
    host: str = ""
    port: int = 0
    mountpoint: str = ""
    user: str = ""
    password: str = ""

    def __repr__(self) -> str:
        return f"SourceUrl({self.shown!r})"

    @property
    def is_caster(self) -> bool:
        """Whether it is an NTRIP caster."""
        return self.scheme in PORTS

    @property
    def has_tls(self) -> bool:
        """Whether the connection is encrypted."""
        return self.scheme == "ntrips"


def parse_source(url: str) -> SourceUrl:
    """Reads the address of a source.

    Raises:
        Refused: with the reason, in which the password does not appear.
    """
    scheme, separator, rest = url.partition("://")
    if not separator or scheme not in SCHEMES:
        reason = f"no scheme {scheme!r}; {nearest(scheme, SCHEMES)}" if separator else "it has no scheme"
        raise Refused(f"corrections: {reason}; write {EXAMPLES}")
    if scheme in SERIAL_SCHEMES:
        wanted = parse_url(url)
        wanted.check_unkeyed("a source of corrections")
        return SourceUrl(scheme=scheme, shown=wanted.address)
    shown = f"{scheme}://{rest.rpartition('@')[2]}"
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
        host.encode("idna")
    except ValueError:  # its text may hold the password
        raise Refused(f"corrections from {shown}: the host or the port is wrong; write {EXAMPLES}") from None
    path = unquote(parts.path.removeprefix("/"))
    if not host:
        raise Refused(f"corrections from {shown}: no host is named; write {EXAMPLES}")
    if scheme == "tcp" and (port is None or path or parts.username is not None):
        raise Refused(f"corrections from {shown}: write tcp://HOST:PORT, with nothing else")
    user, password = unquote(parts.username or ""), unquote(parts.password or "")
    if parts.query or parts.fragment or not _is_plain(path) or not _is_plain(user + password):
        raise Refused(
            f"corrections from {shown}: '?', '#', '%' and spaces in it are written as %3F, %23, %25 and %20; no others may be"
        )
    return SourceUrl(
        scheme=scheme,
        shown=shown,
        host=host,
        port=port or PORTS.get(scheme, 0),
        mountpoint=path,
        user=user,
        password=password,
    )


def _is_plain(text: str) -> bool:
    """Whether it can be part of a request: a line break would begin another header."""
    return text.isprintable()
