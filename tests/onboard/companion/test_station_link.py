"""The link to stations: what is told of it becomes an event, and with a key nothing else is taken or sent."""

import asyncio
from random import Random

import pytest

from gloc3.clock import Clock, run_virtual
from gloc3.exchange import LocalExchange, Publisher
from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.router import Router
from gloc3.mavlink.signing import Signing, timestamp
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.command_interface import CiRequest, Hello, StationRole
from gloc3.messages.envelope import Envelope, Event
from gloc3.messages.summaries import ContactSummary, Health, StationHeard
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.companion.station_link import StationLink, StationLinkSettings

TOPICS = TopicTable.installed()
KEY, OTHER = bytes(range(32)), bytes(32)
CONTACT = ContactSummary(
    station="255",
    t_s=0.0,
    silent_s=1200.0,
    health=Health.WORKING,
    mission="",
    state="",
    doing="",
    policy="",
    landed="under_way",
    battery_percent=80,
    position_m=(0.0, 0.0, 0.0),
    geo=None,
    conditions=[],
    store=1,
    last=0,
    delivered=0,
)


class Ends:
    """A platform and a station at the ends of one link, in virtual time."""

    def __init__(
        self, platform_key: bytes | None, station_key: bytes | None, role: StationRole = StationRole.OPERATOR
    ) -> None:
        self.loop = asyncio.get_running_loop()
        self.memory = MemoryLink(self.loop, Random(3))
        self.here, self.there = LocalExchange(), LocalExchange()
        self.requests: list[Envelope[CiRequest]] = []
        self.events: list[str] = []
        self.reported: list[str] = []
        self.here.subscribe("heron/ci/request", self.requests.append)
        self.heard: list[Envelope[StationHeard]] = []
        self.here.subscribe("heron/ci/heard", self.heard.append)
        self.here.subscribe("heron/components/station_link/event", self._take)
        platform_signing = self._signing(platform_key)
        self.platform = StationLink(
            "heron",
            1,
            self.loop,
            self.here,
            TOPICS,
            7,
            StationLinkSettings(signing=platform_signing, role=role, name="udpin://:14551", member="alice"),
        )
        self.routed = RoutedLink(
            "udpin://:14551",
            Router(Address(1, 191)),
            self.loop,
            [self.platform.receive_frames],
            signed_only=self.platform.signed_only,
        )
        self.memory.b.on_data = self.routed.receive
        self.routed.open(self.memory.b)
        self.platform.open(self.routed)
        self.station = StationLinkCore(
            self.memory.a.send,
            LinkContext(loop=self.loop, exchange=self.there, topics=TOPICS, boot=8, report=self.reported.append),
            LinkSettings(key=station_key),
        )
        self.memory.a.on_data = self.station.receive

    def _signing(self, key: bytes | None) -> Signing | None:
        return None if key is None else Signing(key, link_id=0, now=timestamp(Clock(self.loop).utc_offset_s))

    def _take(self, envelope: Envelope[Event]) -> None:
        self.events.append(envelope.payload.text)

    async def request(self) -> None:
        """Has the station greet the platform for ten seconds, and ask for something in the middle."""
        await asyncio.sleep(5.0)
        request = CiRequest(sender="255", boot=8, sequence=0, body=Hello())
        Publisher(self.there, "station", "client", 8).publish("heron/ci/request", request, self.loop.time())
        await asyncio.sleep(5.0)

    def close(self) -> None:
        self.station.close()
        self.platform.close()


@pytest.mark.parametrize(
    ("platform_key", "station_key", "is_heard"),
    [(None, None, True), (KEY, KEY, True), (KEY, None, False), (None, KEY, False), (KEY, OTHER, False)],
    ids=["no key", "one key", "only onboard", "only at the station", "two keys"],
)
def test_stations_are_taken_by_their_key(platform_key: bytes | None, station_key: bytes | None, is_heard: bool) -> None:
    async def play() -> None:
        ends = Ends(platform_key, station_key)
        await ends.request()
        is_seen = is_heard or station_key is None  # who has no key still hears what is signed
        assert [name for name, _ in ends.station.platforms()] == (["heron"] if is_seen else [])
        assert len(ends.requests) == is_heard
        refused = {None: "not signed", OTHER: "the signature is wrong"}.get(station_key, "")
        if platform_key is not None and not is_heard:
            assert ends.events[0].startswith(f"a frame from 255/190 is dropped ({refused})")
        else:
            assert ends.events == []
        locked_out = [text for text in ends.reported if "ignores this station; see --signing-key" in text]
        assert len(locked_out) == (platform_key is not None and station_key is None), "and the operator is told, once"
        assert bool(ends.station.genuine) == (platform_key == station_key is not None)
        assert bool(ends.station.refusals) == (station_key is not None and not is_heard)
        ends.close()

    run_virtual(play())


@pytest.mark.parametrize("role", list(StationRole))
@pytest.mark.parametrize("key", [None, KEY], ids=["unsigned", "signed"])
def test_a_request_says_how_it_came_and_what_its_sender_may_do_whatever_was_sent(
    role: StationRole, key: bytes | None
) -> None:
    async def play() -> None:
        ends = Ends(key, key, role)
        await asyncio.sleep(5.0)
        forged = CiRequest(sender="255", boot=8, sequence=0, body=Hello(), way="the front door", member="carol")
        Publisher(ends.there, "station", "client", 8).publish("heron/ci/request", forged, ends.loop.time())
        await asyncio.sleep(2.0)
        assert {envelope.payload.role for envelope in ends.heard} == {role}
        came = ends.requests[0].payload
        assert (came.role, came.way) == (role, "udpin://:14551, signed" if key else "udpin://:14551")
        assert came.member == "alice"
        ends.close()

    run_virtual(play())


def test_on_the_wire_it_is_component_191_speaking_in_tunnel_frames_of_our_payload_type() -> None:
    async def play() -> None:
        ends = Ends(None, None)
        received: list[Frame] = []
        ends.memory.a.on_data = lambda data: received.extend(Parser(is_datagram=True).receive(data))
        await asyncio.sleep(3.0)
        assert {tuple(frame.sender) for frame in received} == {(1, 191)}
        reported = [text for frame in received if (text := frame.decode()) is not None]
        assert {(frame.message_id, text.payload_type) for frame, text in zip(received, reported, strict=True)} == {
            (385, 0xC103)
        }
        assert {bytes(text.payload)[0] for text in reported} == {1}, "the version comes first"
        ends.close()

    run_virtual(play())


def test_what_a_person_should_know_of_the_link_is_an_event_of_the_platform() -> None:
    async def play() -> None:
        ends = Ends(None, None)
        await asyncio.sleep(2.0)
        twin = StationLinkCore(
            ends.memory.a.send, LinkContext(loop=ends.loop, exchange=LocalExchange(), topics=TOPICS, boot=99)
        )
        await asyncio.sleep(10.0)
        assert any("255" in text for text in ends.events), "a second station of the same id"
        twin.close()
        ends.close()

    run_virtual(play())


def test_garbage_on_a_signed_link_harms_nobody() -> None:
    async def play() -> None:
        ends = Ends(KEY, KEY)
        ends.routed.receive(bytes(range(256)) + Encoder(9, 1).encode(message("HEARTBEAT", type=6))[:-3])
        await ends.request()
        assert len(ends.requests) == 1
        ends.close()

    run_virtual(play())


@pytest.mark.thorough
def test_after_a_long_silence_a_station_counts_as_reached_only_when_what_is_told_gets_there() -> None:
    async def steps() -> list[str]:
        ends, came = Ends(None, None), list[str]()
        ends.there.subscribe("heron/contact", lambda envelope: came.append(envelope.payload.station))
        publisher = Publisher(ends.here, "heron", "command_server", 5)

        def received(envelope: Envelope[StationHeard]) -> None:
            if envelope.payload.is_reached and (not seen or envelope.t_s > seen[-1] + 60.0):
                publisher.publish("heron/contact", CONTACT, envelope.t_s)
            seen.extend([envelope.t_s] if envelope.payload.is_reached else [])

        seen: list[float] = []
        ends.here.subscribe("heron/ci/heard", received)
        await asyncio.sleep(5.0)
        ends.memory.set_conditions(Conditions(loss=1.0))
        await asyncio.sleep(1200.0)
        ends.memory.set_conditions(Conditions())
        await asyncio.sleep(2.0)
        return came

    assert run_virtual(steps()) == ["255", "255"]
