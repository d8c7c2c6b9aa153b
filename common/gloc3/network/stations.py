"""Requests of stations on the network, on keys that only the sender may write, so that the key proves the sender.

A station sends commands on `PLATFORM/ci/request/STATION` and read-only requests on `PLATFORM/ci/ask/STATION`; inside a
process both are `PLATFORM/ci/request`, as on every middleware.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final

from msgspec.structs import replace

from gloc3.exchange.base import Exchange, Publisher, Unsubscribe
from gloc3.exchange.tunnel.layout import TunnelRole as End
from gloc3.exchange.tunnel.routes import route
from gloc3.messages.command_interface import QUERIES, CiRequest, StationRole
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import StationHeard
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.topics import TopicTable
from gloc3.network.access import MemberRole

CONTACT_S: Final = 1.0
"""Period of contact reports to the platform for each station that is present."""
RELAYED: Final = "network"
"""How these requests came, for the record."""
STATION_ROLES: Final[Mapping[MemberRole | None, StationRole]] = {
    MemberRole.OPERATOR: StationRole.OPERATOR,
    MemberRole.OBSERVER: StationRole.OBSERVER,
}
CHUNKS: Final = "log_chunk"
"""Pieces of logs, which no radio carries."""
COMMANDS: Final = "request"
QUESTIONS: Final = "ask"
DEMANDS: Final = "demand"
"""Velocity demands of manual control; on a level of their own, because they are not requests."""


def key_of(station: str, envelope: Envelope[CiRequest]) -> str:
    """The key of a station's request to a platform."""
    platform = envelope.topic.partition("/")[0]
    return f"{platform}/ci/{QUESTIONS if isinstance(envelope.payload.body, QUERIES) else COMMANDS}/{station}"


def presence(station: str) -> str:
    """The liveliness token of a station."""
    return f"stations/{station}"


def join_platforms(
    network: Exchange,
    inside: Exchange,
    topics: TopicTable,
    station: str,
    carries: Callable[[Envelope[Any]], bool] = lambda _: True,
    is_new: Callable[[Envelope[Any]], bool] = lambda _: True,
) -> Unsubscribe:
    """Joins a station to all platforms on the network: it sends requests and receives their downlink.

    Args:
        network: the exchange that reaches them.
        inside: the station's own.
        topics: topics that are accepted.
        station: the station's name, as its certificate has it.
        carries: whether a request is sent over this link.
        is_new: whether a message has not arrived over another link already.
    """

    def send(envelope: Envelope[CiRequest]) -> None:
        if carries(envelope):
            network.publish(replace(envelope, topic=key_of(station, envelope)))

    def demand(envelope: Envelope[VelocityDemand]) -> None:
        if carries(envelope):
            network.publish(replace(envelope, topic=f"{envelope.topic.partition('/')[0]}/{DEMANDS}/{station}"))

    def handle(envelope: Envelope[Any]) -> None:
        if is_new(envelope):
            inside.publish(envelope)

    undo = [
        network.declare_alive(presence(station)),
        inside.subscribe("*/ci/request", send),
        inside.subscribe("*/velocity_demand", demand),
    ]
    for name, row in topics:
        topic_route = route(name, row)
        if name == CHUNKS or (topic_route is not None and topic_route.sender is End.PLATFORM):
            undo.append(network.subscribe(f"*/{name}", handle))

    def part() -> None:
        for end in undo:
            end()

    return part


class StationBridge:
    """The platform's end: receives stations' requests, and forwards them if their sender is genuine.

    Args:
        network: the exchange that reaches the stations, and to which the command interface server is connected.
        loop: the event loop, for time and timers.
        platform: name of the platform.
        roles: role of each station; others are not accepted.
        boot: of this process.
        forged: called for the first, tenth, hundredth… request that does not match its sender, with the station.
    """

    def __init__(
        self,
        network: Exchange,
        loop: asyncio.AbstractEventLoop,
        platform: str,
        roles: Mapping[str, MemberRole],
        boot: int,
        forged: Callable[[str, str], None],
    ) -> None:
        self.roles = roles
        self.forgeries: Final[dict[str, int]] = {}
        """Number of each station's requests that did not match their sender."""
        self._network = network
        self._inside = network.here
        self._loop = loop
        self._platform = platform
        self._forged = forged
        self._publisher = Publisher(network, platform, "stations", boot)
        self._here: set[str] = set()
        self._undo = [
            *(network.subscribe(f"{platform}/ci/{kind}/*", self._receive) for kind in (COMMANDS, QUESTIONS)),
            network.subscribe(f"{platform}/{DEMANDS}/*", self._receive),
            network.watch(presence("*"), self._add_station),
        ]
        self._timer = loop.call_later(CONTACT_S, self._tick)

    def close(self) -> None:
        """Stops receiving."""
        self._timer.cancel()
        for end in self._undo:
            end()

    def _receive(self, envelope: Envelope[Any]) -> None:
        _, *_, kind, station = envelope.topic.split("/")
        request = envelope.payload
        role = self.roles.get(station)
        reason = _wrong(request, kind, station, role)
        if reason:
            number = self.forgeries[station] = self.forgeries.get(station, 0) + 1
            if number == 10 ** (len(str(number)) - 1):  # 1, 10, 100, …
                self._forged(station, reason if number == 1 else f"{reason} ({number} so far)")
        else:
            request = replace(request, role=STATION_ROLES[role], way=RELAYED)
            topic = "velocity_demand" if kind == DEMANDS else "ci/request"
            self._inside.publish(replace(envelope, topic=f"{self._platform}/{topic}", payload=request))

    def _add_station(self, token: str, is_here: bool) -> None:
        station = token.rpartition("/")[2]
        if is_here and station in self.roles:
            self._here.add(station)
            self._publish_contact(station)
        else:
            self._here.discard(station)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(CONTACT_S, self._tick)
        for station in sorted(self._here):
            self._publish_contact(station)

    def _publish_contact(self, station: str) -> None:
        self._publisher.publish(f"{self._platform}/ci/heard", StationHeard(station=station), self._loop.time())


def _wrong(request: Any, kind: str, station: str, role: MemberRole | None) -> str:
    """Why a request is not what its key says; empty where it is."""
    if not isinstance(request, VelocityDemand if kind == DEMANDS else CiRequest):
        return f"{type(request).__name__} is not a request"
    if role not in STATION_ROLES:
        return f"{station} is not a station of this network"
    if request.sender != station:
        return f"it says that it is of {request.sender!r}"
    if isinstance(request, VelocityDemand):
        return "" if role is MemberRole.OPERATOR else "an observer may not command"
    if isinstance(request.body, QUERIES) != (kind == QUESTIONS):
        return f"{type(request.body).__name__} came as a {'question' if kind == QUESTIONS else 'command'}"
    return ""
