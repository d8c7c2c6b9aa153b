"""MAVLink endpoints: UDP, TCP and serial lines, opened by a URL in MAVSDK's form.

udpin://0.0.0.0:14550          listens, and sends to all known peers; without an address on this computer only
udpout://192.168.1.10:14550    sends to and receives from this address
tcpin://0.0.0.0:5760           listens for clients
tcpout://192.168.1.10:5760     connects, and reconnects when disconnected
serial:///dev/ttyACM0:57600    a serial line; serial_flowcontrol:// with RTS and CTS; with :auto its rate is detected

Options of a link may follow, as in `udpout://192.168.1.10:14550?rate=57600&key=radio.key`:

rate=BIT_S   bandwidth of a radio behind it, each byte counted as ten bits; on a serial line, less than its own rate
key=FILE     the MAVLink signing key of the link
role=observer  onboard: peers on this link may read but not command
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, Protocol, TypeAlias, TypedDict
from urllib.parse import unquote, urlsplit

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.serial_line import SerialEndpoint
from gloc3.mavlink.transport.tcp import TcpClientEndpoint, TcpServerEndpoint
from gloc3.mavlink.transport.udp import UdpClientEndpoint, UdpServerEndpoint, is_loopback

OnData: TypeAlias = Callable[[bytes], None]

NETWORK_SCHEMES: Final = ("udpin", "udpout", "tcpin", "tcpout")
LISTENING_SCHEMES: Final = ("udpin", "tcpin")
SERIAL_SCHEMES: Final = ("serial", "serial_flowcontrol")
LOOPBACK: Final = "127.0.0.1"
"""Default listen address."""
DEFAULT_BAUD: Final = 57_600
AUTO: Final = "auto"
OPTIONS: Final = ("rate", "key", "role")
ROLES: Final = ("operator", "observer")
LEAST_RATE_BIT_S: Final = 1200


class Endpoint(Protocol):
    """One place where bytes go in and out. What it cannot send at once it drops, and counts: it never blocks."""

    url: str
    """The URL as requested."""
    bytes_sent: int
    dropped: int
    """Calls of `send` whose bytes were dropped: no room or no connection."""

    @property
    def bytes_received(self) -> int:
        """What has come in."""

    @property
    def is_datagram(self) -> bool:
        """Whether each received piece holds whole frames only, so that a parser needs no memory."""

    @property
    def is_connected(self) -> bool:
        """Whether there is a peer to send to, as far as can be known."""

    @property
    def problem(self) -> str:
        """Why it is not connected, or the last failure; empty if there was none."""

    @property
    def origin(self) -> str:
        """The host that what is received now comes from; empty where there is only one."""

    @property
    def intruder(self) -> str:
        """The recent peer that claims the id of another peer's autopilot; empty without one."""

    @property
    def local_port(self) -> int | None:
        """Actual port, also where the URL requested any (0); None for a serial line."""

    def send(self, data: bytes) -> None:
        """Sends whole frames to all peers."""

    async def close(self) -> None:
        """Closes it; nothing is received after that."""


class EndpointUrl(msgspec.Struct, frozen=True, kw_only=True):
    """A parsed URL of an endpoint."""

    url: str
    scheme: str
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int | None = DEFAULT_BAUD
    """None where it is to be found."""
    rate_bit_s: int | None = None
    """Bandwidth of a radio behind it, if given."""
    key: str = ""
    """The file with the link's signing key; empty where none was named."""
    role: str = "operator"
    """Permissions of peers on the link."""

    @property
    def address(self) -> str:
        """The URL without options."""
        return self.url.partition("?")[0]

    @property
    def is_open(self) -> bool:
        """Whether it listens where other computers reach it."""
        return self.scheme in LISTENING_SCHEMES and not is_loopback(self.host)

    def warning(self, *, is_signed: bool, advice: str = "add ?key=FILE, or listen on 127.0.0.1") -> str:
        """Warning about an unauthenticated link that is open to a network; empty for others.

        Args:
            is_signed: whether it has a signing key from elsewhere; its own key counts without this.
            advice: what the user can do about it.
        """
        if not self.is_open or is_signed or self.key:
            return ""
        return f"{self.address} is open to the network and not signed: anyone who reaches it can command the vehicle; {advice}"

    def check_unkeyed(self, program: str) -> None:
        """Checks that no option is given that a program without keys and roles would ignore.

        Raises:
            Refused: one is given.
        """
        if self.key or self.role != ROLES[0]:
            raise Refused(f"endpoint {self.url!r}: {program} has links without keys and roles; omit ?key= and ?role=")

    @property
    def line_bit_s(self) -> int | None:
        """What leaves by the link is to stay below, a byte being ten bits; None where there is no such rate."""
        if self.rate_bit_s is not None:
            return self.rate_bit_s
        return self.baud if self.scheme in SERIAL_SCHEMES else None


def parse_url(url: str) -> EndpointUrl:
    """Reads an endpoint's URL.

    Raises:
        Refused: with the reason, and an example of a valid URL.
    """
    scheme, separator, rest = url.partition("://")
    known = (*NETWORK_SCHEMES, *SERIAL_SCHEMES)
    if not separator:
        raise Refused(
            f"endpoint {url!r} has no scheme; write it as udpin://0.0.0.0:14550 or serial:///dev/ttyACM0:57600"
        )
    address, _, options = rest.partition("?")
    if scheme in SERIAL_SCHEMES:
        return _serial_url(url, scheme, address, options)
    if scheme not in NETWORK_SCHEMES:
        hint = {"udp": "use udpin:// to listen or udpout:// to send", "tcp": "use tcpin:// or tcpout://"}.get(scheme)
        raise Refused(f"endpoint {url!r}: no scheme {scheme!r}; {hint or nearest(scheme, known)}")
    try:
        parts = urlsplit(f"{scheme}://{address}")
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise Refused(f"endpoint {url!r}: {error}") from None
    if port is None:
        raise Refused(f"endpoint {url!r} names no port; write it as {scheme}://{host or '0.0.0.0'}:14550")
    if parts.path not in ("", "/") or parts.fragment or parts.username is not None:
        raise Refused(
            f"endpoint {url!r}: nothing but ?rate=, ?key= and ?role= may follow the port, nothing stand before the host"
        )
    if scheme in ("udpout", "tcpout"):
        if not host:
            raise Refused(f"endpoint {url!r} names no host to send to")
        if port == 0:
            raise Refused(f"endpoint {url!r}: port 0 is for listening only")
    return EndpointUrl(url=url, scheme=scheme, host=host or LOOPBACK, port=port, **_options(url, options))


class _Options(TypedDict, total=False):
    rate_bit_s: int
    key: str
    role: str


def _options(url: str, text: str) -> _Options:
    """What follows an address."""
    found: _Options = {}
    for option in filter(None, text.split("&")):
        name, _, value = option.partition("=")
        if name == "key" and value:
            found["key"] = unquote(value)
        elif name == "rate" and value.isascii() and value.isdigit() and int(value) >= LEAST_RATE_BIT_S:
            found["rate_bit_s"] = int(value)
        elif name == "role" and value in ROLES:
            found["role"] = value
        elif name == "rate":
            raise Refused(f"endpoint {url!r}: {value!r} is no rate; give bits a second, {LEAST_RATE_BIT_S} or more")
        elif name == "key":
            raise Refused(f"endpoint {url!r} names no key file; write ?key=FILE")
        elif name == "role":
            raise Refused(f"endpoint {url!r}: {value!r} is no role; {nearest(value, ROLES)}")
        else:
            raise Refused(f"endpoint {url!r}: no option {name!r}; {nearest(name, OPTIONS)}")
    return found


def _serial_url(url: str, scheme: str, address: str, options: str) -> EndpointUrl:
    found = _options(url, options)
    device, separator, baud = address.rpartition(":")
    if not separator:
        device, baud = address, str(DEFAULT_BAUD)
    if not device:
        raise Refused(f"endpoint {url!r} names no device; write it as {scheme}:///dev/ttyACM0:57600")
    if baud == AUTO:
        return EndpointUrl(url=url, scheme=scheme, device=device, baud=None, **found)
    if not baud.isascii() or not baud.isdigit() or not 1 <= int(baud) <= 10_000_000:
        raise Refused(f"endpoint {url!r}: {baud!r} is no baud rate; give a number, or {AUTO} to have it found")
    return EndpointUrl(url=url, scheme=scheme, device=device, baud=int(baud), **found)


async def open_endpoint(
    url: str, loop: asyncio.AbstractEventLoop, on_data: OnData, *, pins_autopilot: bool = False
) -> Endpoint:
    """Opens an endpoint.

    An address that is not available is refused at once. The endpoint waits for a peer or device that is not present
    yet.

    Args:
        url: as above.
        loop: the running loop, in wall time.
        on_data: called with received data, always on the loop's thread.
        pins_autopilot: on an endpoint with several peers, frames of a second peer that claims the id of an autopilot
            are ignored.

    Raises:
        Refused: the URL is wrong, the port is in use, the host has no address, with the reason.
    """
    wanted = parse_url(url)
    match wanted.scheme:
        case "udpin":
            return await UdpServerEndpoint.open(
                url, loop, on_data, wanted.host, wanted.port, pins_autopilot=pins_autopilot
            )
        case "udpout":
            return await UdpClientEndpoint.open(
                url, loop, on_data, wanted.host, wanted.port, pins_autopilot=pins_autopilot
            )
        case "tcpin":
            return await TcpServerEndpoint.open(
                url, loop, on_data, wanted.host, wanted.port, pins_autopilot=pins_autopilot
            )
        case "tcpout":
            return TcpClientEndpoint(url, loop, on_data, wanted.host, wanted.port)
        case _:
            has_flow_control = wanted.scheme == "serial_flowcontrol"
            return SerialEndpoint(url, loop, on_data, wanted.device, wanted.baud, has_flow_control=has_flow_control)
