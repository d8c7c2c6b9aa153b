"""A station of version 0.1 commands today's platform, and today's station follows a platform of version 0.1.

The bytes are those of a flight in which a mission was loaded, read back, started, watched and done.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest
from tests.direct_link import routed_link

from gloc3.clock import VirtualLoop
from gloc3.exchange.base import LocalExchange
from gloc3.exchange.mavlink import MavlinkExchange
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.events import Happening, PeerChanged, TunnelTrouble
from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.mavlink.codec import Address, Parser
from gloc3.messages.command_interface import CiRequest, LoadMission, Steer, Verb
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ComponentTable, MissionSummary
from gloc3.messages.topics import TopicTable
from gloc3.messages.watch import Sample
from gloc3_groundstation.station.station import Station
from gloc3_onboard.companion.station_link import StationLink

from .released import Piece, transcript

PLATFORM, STATION = Address(1, 191), Address(255, 190)
TRANSCRIPT = transcript()
REQUESTS = [
    *("Hello", "Control", "LoadMission", "ReadMission", "Steer"),
    *("ListTopics", "Watch", "Preflight", "ListLogs", "ReadMission"),
]


@pytest.fixture
def loop() -> Iterator[VirtualLoop]:
    made = VirtualLoop()
    with closing(made):
        yield made


def play(loop: VirtualLoop, pieces: list[Piece], receive: Callable[[bytes], None]) -> None:
    """Has everything arrive when it arrived then."""

    async def arrive() -> None:
        for piece in pieces:
            await asyncio.sleep(piece.t_s - loop.time())
            receive(piece.data)

    loop.run_until_complete(arrive())


def test_the_requests_of_a_station_of_0_1_reach_the_platform(loop: VirtualLoop) -> None:
    topics = TopicTable.installed()
    exchange, came = LocalExchange(topics), list[Envelope[Any]]()
    exchange.subscribe("pelican/**", came.append)
    link = StationLink("pelican", 1, loop, exchange, topics, TRANSCRIPT.platform_boot)
    play(loop, TRANSCRIPT.sent_by("station"), routed_link(link, "udpin://:14550", loop).receive)
    problems = [envelope.payload for envelope in came if envelope.topic.endswith("/event")]
    assert not problems
    requests = [envelope.payload for envelope in came if isinstance(envelope.payload, CiRequest)]
    assert [request.body.__struct_config__.tag for request in requests] == REQUESTS
    (load,) = (request.body for request in requests if isinstance(request.body, LoadMission))
    assert "take_off: {height_m: 0.4}" in load.text
    assert [request.body.verb for request in requests if isinstance(request.body, Steer)] == [Verb.START]
    link.close()


def test_a_station_follows_a_platform_of_0_1(loop: VirtualLoop) -> None:
    topics = TopicTable.installed()
    tunnel = TunnelEndpoint(TunnelRole.STATION, "255", STATION, TRANSCRIPT.station_boot, topics)
    exchange = MavlinkExchange(tunnel, loop, lambda _: None)
    events, came = list[Happening](), list[Any]()
    exchange.listen(events.append)
    exchange.subscribe("pelican/**", lambda envelope: came.append(envelope.payload))
    station = Station(exchange, loop, "255", TRANSCRIPT.station_boot)
    parser = Parser(is_datagram=True)

    def receive(data: bytes) -> None:
        for frame in parser.receive(data):
            message = frame.decode()
            if message is not None and message.name == "TUNNEL":
                exchange.receive(message, frame.sender)

    play(loop, TRANSCRIPT.sent_by("platform"), receive)
    assert not [what for what in events if isinstance(what, TunnelTrouble)]
    assert [what.name for what in events if isinstance(what, PeerChanged)] == ["pelican"]
    assert {ComponentTable, MissionSummary, Sample} <= {type(message) for message in came}
    platform = station.fleet.get("pelican")
    assert platform is not None
    assert not platform.is_incomplete
    assert platform.mission is not None
    assert platform.mission.value.state == "done"
    assert len(platform.lines) == 20
    counters = tunnel.counters
    assert (counters.versions_differ, counters.damaged, counters.other_version, counters.not_accepted) == (0, 0, 0, 0)
    station.close()
    exchange.close()
