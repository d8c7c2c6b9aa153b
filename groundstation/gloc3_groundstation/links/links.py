"""All links of a station with their sockets: opened, closed, measured and queried."""

import asyncio
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final, Generic, TypeVar

import msgspec

from gloc3.errors import Refused
from gloc3.exchange.tunnel.pacing import budget_of
from gloc3.mavlink.message import Address
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3_groundstation.links.forwarding import Forwarding, ForwardLink, check_forward
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.links.station_routes import LINE, NETWORK

if TYPE_CHECKING:
    from gloc3.network.file import Membership
    from gloc3_groundstation.links.network_route import NetworkRoute

MEASURE_EVERY_S: Final = 1.0
L = TypeVar("L")


class _Opened(Generic[L]):
    """A link with its socket, and how much passes."""

    def __init__(self, endpoint: Endpoint, link: L) -> None:
        self.endpoint: Final = endpoint
        self.link: Final = link
        self.rates = (0.0, 0.0)
        self._counted = (0, 0)

    def measure(self, period_s: float) -> None:
        """Takes the bytes since the last time."""
        now = self.endpoint.bytes_received, self.endpoint.bytes_sent
        was, self._counted = self._counted, now
        self.rates = (now[0] - was[0]) / period_s, (now[1] - was[1]) / period_s


class Links:
    """All links of a station with their sockets; initially none.

    Args:
        context: shared by the links.
        signing_key: if given here or in a URL, all sent frames are signed, and received ones must be.
    """

    def __init__(self, context: LinkContext, signing_key: bytes | None = None) -> None:
        self._signing_key = signing_key
        self._open: list[_Opened[StationLinkCore]] = []
        self._forwarded: list[_Opened[ForwardLink]] = []
        self._forwarding = Forwarding(context.own, lambda: [each.link for each in self._open], context.report)
        self._context = msgspec.structs.replace(context, forward=self._from_vehicle)
        self._network: NetworkRoute | None = None
        self._is_closed = False
        self._timer: asyncio.TimerHandle | None = None

    def join(self, network: "Membership") -> None:
        """Joins a network of platforms and stations.

        Raises:
            Gloc3Error: a listen address is not available.
        """
        from gloc3_groundstation.links.network_route import NetworkRoute  # with Zenoh and all of its cryptography

        context = self._context
        self._network = NetworkRoute(network, context.routes, lambda text: context.report(f"network: {text}"))
        self._network.open(context.loop, context.exchange, context.topics)

    async def add(self, url: str) -> None:
        """Opens one more link.

        Raises:
            Refused: it is open already, the URL is wrong, or its address cannot be had.
            InputError: the key file that it names has no key, or others may read it.
        """
        if self._is_closed:
            raise Refused("the station is closed")
        if self._is_open(url):
            raise Refused(f"link {url} is open already")
        wanted = parse_url(url)
        key = read_signing_key(Path(wanted.key).expanduser()) if wanted.key else self._signing_key
        links: list[StationLinkCore] = []
        endpoint = await open_endpoint(url, self._context.loop, lambda data: links[0].receive(data) if links else None)
        settings = LinkSettings(
            url=url,
            is_datagram=endpoint.is_datagram,
            budget=budget_of(url, is_signed=key is not None),
            rank=NETWORK if wanted.line_bit_s is None else LINE,
            key=key,
        )
        links.append(self._begin(endpoint, settings))
        if warning := wanted.warning(is_signed=key is not None):
            self._context.report(warning)

    async def forward(self, url: str, *, is_both: bool) -> None:
        """Opens a link to another station, to which the vehicles' frames are forwarded.

        Args:
            url: of the link; a serial line is none.
            is_both: frames from there are passed to the vehicles.

        Raises:
            Refused: it is open already, the URL is wrong, or its address cannot be had.
        """
        if self._is_closed:
            raise Refused("the station is closed")
        if self._is_open(url):
            raise Refused(f"link {url} is open already")
        check_forward(url)
        context = self._context
        link = ForwardLink(is_both=is_both)

        def receive(data: bytes) -> None:
            self._forwarding.from_station(link, data, context.loop.time())

        endpoint = link.endpoint = await open_endpoint(url, context.loop, receive)
        self._forwarded.append(_Opened(endpoint, link))
        self._forwarding.links.append(link)
        if is_both and (warning := parse_url(url).warning(is_signed=False, advice="listen on 127.0.0.1")):
            context.report(warning)

    def _is_open(self, url: str) -> bool:
        urls = [each.endpoint.url for each in self._open] + [each.endpoint.url for each in self._forwarded]
        return url in urls

    def _from_vehicle(self, link: StationLinkCore, frame: Frame) -> None:
        self._forwarding.from_vehicle(link, frame, self._context.loop.time())

    def attach(self, end: MemoryEnd) -> StationLinkCore:
        """Opens a link in memory, as flights in virtual time have it."""
        link = self._begin(end, LinkSettings(key=self._signing_key))
        end.on_data = link.receive
        return link

    def _begin(self, endpoint: Endpoint, settings: LinkSettings) -> StationLinkCore:
        link = StationLinkCore(endpoint.send, self._context, settings)
        self._open.append(_Opened(endpoint, link))
        if self._timer is None:
            self._timer = self._context.loop.call_later(MEASURE_EVERY_S, self._measure)
        return link

    async def remove(self, url: str) -> None:
        """Closes a link.

        Raises:
            Refused: there is none of that URL.
        """
        forwarded = [opened for opened in self._forwarded if opened.endpoint.url == url]
        for each in forwarded:
            self._forwarded.remove(each)
            self._forwarding.links.remove(each.link)
            await each.endpoint.close()
        if forwarded:
            return
        found = [opened for opened in self._open if opened.endpoint.url == url]
        if not found:
            raise Refused(f"there is no link {url}")
        self._open.remove(found[0])
        found[0].link.close()
        await found[0].endpoint.close()

    def snapshots(self, platforms: Iterable[str]) -> tuple[LinkSnapshot, ...]:
        """All links as they are now, with those of some platforms that are behind each."""
        names = tuple(platforms)
        network = () if self._network is None else (self._network.snapshot(names),)
        return (
            network
            + tuple(
                LinkSnapshot(
                    url=endpoint.url,
                    is_connected=endpoint.is_connected,
                    problem=endpoint.problem,
                    bytes_in_s=opened.rates[0],
                    bytes_out_s=opened.rates[1],
                    frames_in=link.frames_received,
                    frames_out=link.frames_sent,
                    dropped=endpoint.dropped,
                    received=tuple(link.received()),
                    platforms=tuple(name for name, _ in link.platforms() if name in names),
                    lost=link.lost,
                    refusals=link.refusals,
                    genuine=link.genuine,
                )
                for opened in self._open
                for endpoint, link in ((opened.endpoint, opened.link),)
            )
            + tuple(
                LinkSnapshot(
                    url=each.endpoint.url,
                    is_connected=each.endpoint.is_connected,
                    problem=each.endpoint.problem,
                    bytes_in_s=each.rates[0],
                    bytes_out_s=each.rates[1],
                    frames_in=each.link.parser.frames_received,
                    frames_out=each.link.sent,
                    dropped=each.endpoint.dropped,
                    forwards=each.link.describe(),
                )
                for each in self._forwarded
            )
        )

    def _measure(self) -> None:
        for opened in self._open:
            opened.measure(MEASURE_EVERY_S)
        for each in self._forwarded:
            each.measure(MEASURE_EVERY_S)
        self._timer = self._context.loop.call_later(MEASURE_EVERY_S, self._measure)

    def describe(self) -> str:
        """The links, each with its problem or its live peers."""
        parts = []
        for opened in self._open:
            endpoint, link = opened.endpoint, opened.link
            received = ", ".join(link.received())
            aside = (
                endpoint.problem
                if endpoint.problem and not endpoint.is_connected
                else f"{received} heard"
                if received
                else f"{link.refused} frames dropped, not signed with our key"
                if link.refused
                else ""
            )
            parts.append(f"{endpoint.url} ({aside})" if aside else endpoint.url)
        if self._network is not None:
            parts.insert(0, self._network.url)
        return ", ".join(parts)

    def round_trip_s(self, platform: str) -> float | None:
        """The same over the quickest link that leads there."""
        trips = [trip for each in self._open if (trip := each.link.round_trip_s(platform)) is not None]
        return min(trips, default=None)

    def routes(self) -> list[tuple[str, StationLinkCore]]:
        """All links with their URLs."""
        return [(each.endpoint.url, each.link) for each in self._open]

    def autopilots(self) -> list[tuple[StationLinkCore, Address]]:
        """Every live autopilot, with its link."""
        return [(each.link, peer.address) for each in self._open for peer in each.link.autopilots]

    async def close(self) -> None:
        """Closes all."""
        self._is_closed = True
        if self._network is not None:
            self._network.close()
        if self._timer is not None:
            self._timer.cancel()
        for opened in self._open:
            opened.link.close()
            await opened.endpoint.close()
        for each in self._forwarded:
            await each.endpoint.close()
        self._open.clear()
        self._forwarded.clear()
