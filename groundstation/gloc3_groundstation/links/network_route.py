"""A route to the platforms over Zenoh: encrypted, members identified by certificates."""

import asyncio
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from random import SystemRandom
from typing import TYPE_CHECKING, Any

from gloc3.clock import passed, utc_now
from gloc3.errors import Gloc3Error
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.messages.command_interface import StationRole
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3.network.access import MemberRole
from gloc3.network.file import Membership
from gloc3.network.spreading import PASSED_ON_S, RevocationSpreader
from gloc3.network.stations import join_platforms
from gloc3_groundstation.links.link import Report
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.links.station_routes import FRESH_S, OWN_NETWORK, StationRoute, StationRoutes

if TYPE_CHECKING:
    from gloc3.exchange.zenoh import ZenohExchange


def role_of(membership: Membership) -> StationRole:
    """What a member may do as a station."""
    return StationRole.OBSERVER if membership.file.own.role is MemberRole.OBSERVER else StationRole.OPERATOR


class NetworkRoute:
    """The station as a member of the network.

    Args:
        membership: its network file.
        routes: all of the station's.
        reported: called with text for users.
    """

    def __init__(self, membership: Membership, routes: StationRoutes, reported: Report) -> None:
        self._membership = membership
        self._routes = routes
        self._reported = reported
        self._stack = ExitStack()
        self._received_s: dict[str, float] = {}
        self._received = 0
        self._now_s: Callable[[], float] = lambda: 0.0
        self._problems: Callable[[], dict[str, int]] = dict
        self._cut: asyncio.Task[None] | None = None

    @property
    def url(self) -> str:
        """What it is called among the links."""
        file = self._membership.file
        return f"network {file.network} as {file.member}, {file.own.role}"

    def open(self, loop: asyncio.AbstractEventLoop, exchange: Exchange, topics: TopicTable) -> None:
        """Joins; the platforms need not be present yet.

        Raises:
            Gloc3Error: a listen address is not available.
        """
        from gloc3.exchange.zenoh import open_exchange

        self._now_s = loop.time
        membership = self._membership
        if warning := membership.expiry(utc_now()):
            self._reported(warning)
        route = self._routes.open(StationRoute(OWN_NETWORK, self._age_s))
        self._stack.callback(self._routes.close, route)
        network = self._stack.enter_context(
            open_exchange(membership.node(), loop, topics, lambda _, text: self._reported(text), membership.settings())
        )
        self._problems = network.problems

        def adopt(found: Membership, *, is_anyone_out: bool) -> None:
            self._membership = found
            if is_anyone_out:
                self._cut = loop.create_task(self._cut_off(network))

        spreader = RevocationSpreader(network, loop, SystemRandom(), membership, adopt, self._reported)
        self._stack.callback(spreader.close)

        def handle(envelope: Envelope[Any]) -> bool:
            self._received += 1
            self._received_s[envelope.topic.partition("/")[0]] = loop.time()
            return self._routes.is_new(route, envelope)

        part: Unsubscribe = join_platforms(
            network,
            exchange,
            topics,
            membership.file.member,
            carries=partial(self._routes.carries, route),
            is_new=handle,
            signer=membership.signer(),
            unsent=self._reported,
            watched=membership.file.watches,
        )
        self._stack.callback(part)

    def close(self) -> None:
        """Leaves."""
        if self._cut is not None:
            self._cut.cancel()
        self._stack.close()

    async def _cut_off(self, network: "ZenohExchange") -> None:
        """Closes the connections to members that are not accepted any more."""
        await passed(PASSED_ON_S)
        try:
            await network.renew(self._membership.node(), self._membership.settings())
        except Gloc3Error as error:
            self._reported(str(error))

    def snapshot(self, platforms: Iterable[str]) -> LinkSnapshot:
        """How it is now, with those of some platforms that are there."""
        now_s = self._now_s()
        here = [name for name, received_s in self._received_s.items() if now_s - received_s < FRESH_S]
        return LinkSnapshot(
            url=self.url,
            is_connected=bool(here),
            problem=""
            if here
            else f"no platform is heard at {', '.join(self._membership.file.connect) or 'its address'}",
            frames_in=self._received,
            dropped=sum(self._problems().values()),
            received=tuple(sorted(here)),
            platforms=tuple(name for name in platforms if name in here),
        )

    def _age_s(self, platform: str) -> float | None:
        received_s = self._received_s.get(platform)
        return None if received_s is None else self._now_s() - received_s
