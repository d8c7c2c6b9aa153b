"""All links of a station with their sockets: opened and closed while it runs, measured, and asked together."""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.exchange.link_budget import budget_of
from gloc3.exchange.tunnel.happenings import Undelivered
from gloc3.link.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.link.message import Address
from gloc3.link.signing import Signing, timestamp
from gloc3.link.signing_key import read_signing_key
from gloc3.network.file import Membership
from gloc3.topics import TopicTable
from gloc3_groundstation.link import GivenUp, Link, Tap, Told
from gloc3_groundstation.link_snapshot import LinkSnapshot
from gloc3_groundstation.network_way import NetworkWay
from gloc3_groundstation.ways import LINE, NETWORK, Way, Ways

MEASURE_EVERY_S: Final = 1.0


class _Opened:
    """A link with its socket, and how much passes."""

    def __init__(self, way: int, endpoint: Endpoint, link: Link) -> None:
        self.way: Final = way
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
    """All links of a station with their sockets."""

    def __init__(self, ways: Ways | None = None) -> None:
        """None yet.

        Args:
            ways: all ways of the station, those over other networks included; None where there are no others.
        """
        self._open: list[_Opened] = []
        self._ways = ways or Ways()
        self._network: NetworkWay | None = None
        self._make: Callable[[str, Endpoint, int, bytes | None], Link] | None = None
        self._signing_key: bytes | None = None
        self._timer: asyncio.TimerHandle | None = None

    async def open(
        self,
        urls: Sequence[str],
        *,
        exchange: Exchange,
        topics: TopicTable,
        system: int,
        boot: int,
        told: Told,
        undelivered: GivenUp = lambda _: None,
        tap: Tap = lambda _: None,
        signing_key: bytes | None = None,
        network: Membership | None = None,
    ) -> None:
        """Opens links; with a key, theirs or that of their URL, all frames are signed, and those of others must be.

        See `Link` for the arguments, and `Ways.is_lost` for what is told as undelivered.

        Raises:
            Refused: a URL is wrong, or its address cannot be had.
        """
        loop = asyncio.get_running_loop()
        clock = Clock(loop)

        if network is not None:
            self._network = NetworkWay(network, self._ways, lambda text: told(f"network: {text}"))
            self._network.open(loop, exchange, topics)
        name = "" if network is None else network.file.member

        def make(url: str, endpoint: Endpoint, way: int, key: bytes | None) -> Link:
            return Link(
                endpoint.send,
                loop=loop,
                exchange=exchange,
                topics=topics,
                system=system,
                boot=boot,
                told=lambda text: told(f"{url}: {text}"),
                name=name,
                undelivered=partial(self._give_up, way, undelivered),
                is_datagram=endpoint.is_datagram,
                budget=budget_of(url, is_signed=key is not None),
                tap=tap,
                carries=partial(self._ways.carries, way),
                is_new=partial(self._ways.is_new, way),
                signing=None
                if key is None
                else Signing(key, link_id=way & 0xFF, now=timestamp(clock.utc_s()), is_clock_right=clock.is_utc_right),
            )

        self._make, self._signing_key = make, signing_key
        self._timer = loop.call_later(MEASURE_EVERY_S, self._measure, loop)
        for url in urls:
            await self.add(url)

    async def add(self, url: str) -> None:
        """Opens one more link; `open` comes first.

        Raises:
            Refused: it is open already, the URL is wrong, or its address cannot be had.
            InputError: the key file that it names has no key, or others may read it.
        """
        if self._make is None:
            raise Refused("the station is closed")
        if any(opened.endpoint.url == url for opened in self._open):
            raise Refused(f"link {url} is open already")
        file = parse_url(url).key
        key = read_signing_key(Path(file).expanduser()) if file else self._signing_key
        made: list[Link] = []
        loop = asyncio.get_running_loop()
        endpoint = await open_endpoint(url, loop, lambda data: made[0].receive(data) if made else None)
        rank = NETWORK if parse_url(url).line_bit_s is None else LINE
        way = self._ways.open(Way(rank, lambda platform: made[0].age_s(platform) if made else None))
        made.append(self._make(url, endpoint, way, key))
        self._open.append(_Opened(way, endpoint, made[0]))

    async def remove(self, url: str) -> None:
        """Closes a link.

        Raises:
            Refused: there is none of that URL.
        """
        found = [opened for opened in self._open if opened.endpoint.url == url]
        if not found:
            raise Refused(f"there is no link {url}")
        self._open.remove(found[0])
        self._ways.close(found[0].way)
        found[0].link.close()
        await found[0].endpoint.close()

    def snapshots(self, platforms: Iterable[str]) -> tuple[LinkSnapshot, ...]:
        """All links as they are now, with those of some platforms that are behind each."""
        names = tuple(platforms)
        network = () if self._network is None else (self._network.snapshot(names),)
        return network + tuple(
            LinkSnapshot(
                url=endpoint.url,
                is_connected=endpoint.is_connected,
                problem=endpoint.problem,
                bytes_in_s=opened.rates[0],
                bytes_out_s=opened.rates[1],
                frames_in=link.frames_received,
                frames_out=link.frames_sent,
                dropped=endpoint.dropped,
                heard=tuple(link.heard()),
                platforms=tuple(name for name, _ in link.platforms() if name in names),
                lost=link.lost,
                refusals=link.refusals,
                genuine=link.genuine,
            )
            for opened in self._open
            for endpoint, link in ((opened.endpoint, opened.link),)
        )

    def _measure(self, loop: asyncio.AbstractEventLoop) -> None:
        for opened in self._open:
            opened.measure(MEASURE_EVERY_S)
        self._timer = loop.call_later(MEASURE_EVERY_S, self._measure, loop)

    def _give_up(self, way: int, undelivered: GivenUp, lost: Undelivered) -> None:
        if self._ways.is_lost(way, lost):
            undelivered(lost)

    def describe(self) -> str:
        """The links, with what is wrong with each or who is heard on it."""
        parts = []
        for opened in self._open:
            endpoint, link = opened.endpoint, opened.link
            heard = ", ".join(link.heard())
            aside = (
                endpoint.problem
                if endpoint.problem and not endpoint.is_connected
                else f"{heard} heard"
                if heard
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

    def ways(self) -> list[tuple[str, Link]]:
        """All links with their URLs."""
        return [(each.endpoint.url, each.link) for each in self._open]

    def autopilots(self) -> list[tuple[Link, Address]]:
        """Every autopilot that is heard now, with the link on which it is."""
        return [(each.link, peer.address) for each in self._open for peer in each.link.autopilots]

    async def close(self) -> None:
        """Closes all."""
        self._make = None
        if self._network is not None:
            self._network.close()
        if self._timer is not None:
            self._timer.cancel()
        for opened in self._open:
            self._ways.close(opened.way)
            opened.link.close()
            await opened.endpoint.close()
        self._open.clear()
