"""A way to the platforms over a network of their own (Zenoh, encrypted, each member known by its certificate)."""

import asyncio
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from typing import Any

from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.messages.command_interface import StationRole
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3.network.access import Role
from gloc3.network.file import Membership
from gloc3.network.stations import join_platforms
from gloc3_groundstation.links.link import Report
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.links.ways import FRESH_S, OWN_NETWORK, Way, Ways


def role_of(membership: Membership) -> StationRole:
    """What a member may do as a station."""
    return StationRole.OBSERVER if membership.file.own.role is Role.OBSERVER else StationRole.OPERATOR


class NetworkWay:
    """The station as a member of the network.

    Args:
        membership: its network file.
        ways: all of the station's.
        told: is told in words what a person should know.
    """

    def __init__(self, membership: Membership, ways: Ways, told: Report) -> None:
        self._membership = membership
        self._ways = ways
        self._told = told
        self._stack = ExitStack()
        self._heard_s: dict[str, float] = {}
        self._received = 0
        self._now_s: Callable[[], float] = lambda: 0.0
        self._troubles: Callable[[], dict[str, int]] = dict

    @property
    def url(self) -> str:
        """What it is called among the links."""
        file = self._membership.file
        return f"network {file.network} as {file.member}, {file.own.role}"

    def open(self, loop: asyncio.AbstractEventLoop, exchange: Exchange, topics: TopicTable) -> None:
        """Joins; the platforms need not be there yet.

        Raises:
            Gloc3Error: an address that it is to listen on cannot be had.
        """
        from gloc3.exchange.zenoh import open_exchange

        self._now_s = loop.time
        membership = self._membership
        way = self._ways.open(Way(OWN_NETWORK, self._age_s))
        self._stack.callback(self._ways.close, way)
        network = self._stack.enter_context(
            open_exchange(membership.node(), loop, topics, lambda _, text: self._told(text), membership.settings())
        )
        self._troubles = network.troubles

        def take(envelope: Envelope[Any]) -> bool:
            self._received += 1
            self._heard_s[envelope.topic.partition("/")[0]] = loop.time()
            return self._ways.is_new(way, envelope)

        part: Unsubscribe = join_platforms(
            network, exchange, topics, membership.file.member, carries=partial(self._ways.carries, way), is_new=take
        )
        self._stack.callback(part)

    def close(self) -> None:
        """Leaves."""
        self._stack.close()

    def snapshot(self, platforms: Iterable[str]) -> LinkSnapshot:
        """How it is now, with those of some platforms that are there."""
        now_s = self._now_s()
        here = [name for name, heard_s in self._heard_s.items() if now_s - heard_s < FRESH_S]
        return LinkSnapshot(
            url=self.url,
            is_connected=bool(here),
            problem=""
            if here
            else f"no platform is heard at {', '.join(self._membership.file.connect) or 'its address'}",
            frames_in=self._received,
            dropped=sum(self._troubles().values()),
            heard=tuple(sorted(here)),
            platforms=tuple(name for name in platforms if name in here),
        )

    def _age_s(self, platform: str) -> float | None:
        heard_s = self._heard_s.get(platform)
        return None if heard_s is None else self._now_s() - heard_s
