"""Requests of stations on the network, signed by their members, on keys that only the sender may write.

A station sends commands on `PLATFORM/ci/request/STATION` and read-only requests on `PLATFORM/ci/ask/STATION`; inside a
process both are `PLATFORM/ci/request`, as on every middleware. While it holds control of a platform, it says every second
that it is there, signed too: whoever forwards messages cannot keep up a contact that is lost.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from random import SystemRandom
from typing import Any, Final, NamedTuple

from msgspec.structs import replace

from gloc3.clock import Clock, utc_now
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange, Publisher, Unsubscribe
from gloc3.exchange.tunnel.layout import TunnelRole as End
from gloc3.exchange.tunnel.routes import route
from gloc3.messages.command_interface import QUERIES, CiRequest, Emergency, EmergencyVerb, StationRole
from gloc3.messages.envelope import Envelope, SignedMessage, Source
from gloc3.messages.summaries import ControlState, StationHeard, Summary
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import WireError, type_name
from gloc3.network.access import MemberRole
from gloc3.network.platform_clocks import PlatformClocks
from gloc3.network.regions import topic_of as region_topic
from gloc3.network.signatures import RequestSigner, RequestVerifier

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
PRESENT_S: Final = 2.0
"""So long a sign of presence may be on the way, s."""
DEMAND_S: Final = 2.0
"""So long a velocity demand may be on the way, s; what is later than the others of its session is dropped sooner."""
MOST_AGE_S: Final = 60.0
"""Older messages are refused where the platform's clock shows the right time, s."""
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
    *,
    signer: RequestSigner,
    unsent: Callable[[str], None],
    watched: Sequence[str] = (),
) -> Unsubscribe:
    """Joins a station to all platforms on the network: it sends requests and receives their downlink.

    Args:
        network: the exchange that reaches them.
        inside: the station's own.
        topics: topics that are accepted.
        station: the station's name, as its certificate has it.
        carries: whether a request is sent over this link.
        is_new: whether a message has not arrived over another link already.
        signer: signs what the station sends.
        unsent: called with the reason where it does not, and nothing is sent.
        watched: the platforms that are received; empty for all. Of others come the summaries of their regions.
    """
    loop = asyncio.get_running_loop()
    clocks, now_s, sent, controlled = PlatformClocks(), loop.time, Counter[str](), set[str]()
    source = Source(station, "presence", SystemRandom().getrandbits(32))

    def sign(envelope: Envelope[Any], key: str, until_s: float) -> None:
        boot = clocks.boot(key.partition("/")[0])
        utc_s = utc_now().timestamp()
        numbered = replace(envelope, topic=key, sequence=sent[key])
        sent[key] += 1
        try:
            signed = signer.sign(numbered, topics.types, until_s=until_s, boot=boot, utc_s=utc_s)
        except Refused as error:
            unsent(f"not sent: {error}")
        else:
            network.publish(signed)

    def send(envelope: Envelope[CiRequest]) -> None:
        if carries(envelope):
            sign(envelope, key_of(station, envelope), envelope.payload.until_s)

    def demand(envelope: Envelope[VelocityDemand]) -> None:
        if carries(envelope):
            platform = envelope.topic.partition("/")[0]
            sign(envelope, f"{platform}/{DEMANDS}/{station}", clocks.until_s(platform, now_s(), DEMAND_S))

    def handle(envelope: Envelope[Any]) -> None:
        payload, platform = envelope.payload, envelope.topic.partition("/")[0]
        if isinstance(payload, Summary):
            clocks.receive(envelope, now_s())
        elif isinstance(payload, ControlState) and payload.holder == station:
            controlled.add(platform)
        elif isinstance(payload, ControlState):
            controlled.discard(platform)
        if is_new(envelope):
            inside.publish(envelope)

    def be_present() -> None:
        timers[:] = [loop.call_later(CONTACT_S, be_present)]
        for platform in sorted(controlled):
            key, until_s = f"{platform}/ci/{QUESTIONS}/{station}", clocks.until_s(platform, now_s(), PRESENT_S)
            heard = StationHeard(station=station)
            sign(Envelope(key, source, 0, now_s(), "", type_name(StationHeard), heard), key, until_s)

    timers = [loop.call_later(CONTACT_S, be_present)]
    undo = [
        network.declare_alive(presence(station)),
        inside.subscribe("*/ci/request", send),
        inside.subscribe("*/velocity_demand", demand),
    ]
    for name, row in topics:
        topic_route = route(name, row)
        if name == CHUNKS or (topic_route is not None and topic_route.sender is End.PLATFORM):
            undo += [network.subscribe(f"{platform}/{name}", handle) for platform in watched or ("*",)]
    undo.append(network.subscribe(region_topic("*"), inside.publish))

    def part() -> None:
        timers[0].cancel()
        for end in undo:
            end()

    return part


class BridgeContext(NamedTuple):
    """The platform's side of the bridge."""

    platform: str
    loop: asyncio.AbstractEventLoop
    clock: Clock
    topics: TopicTable


class BridgeMembers(NamedTuple):
    """The members of the network."""

    roles: Mapping[str, MemberRole]
    """Of each member; others are not accepted."""
    verifier: RequestVerifier


class StationBridge:
    """The platform's end: receives stations' requests, and forwards them if their sender is genuine.

    A command has to name the command interface server that runs now and a time limit by its clock, so that one that was
    held back on the way is not carried out later; the server itself carries none out twice.

    Args:
        network: the exchange that reaches the stations, and to which the command interface server is connected.
        context: the platform's name, its message types and clock.
        members: the members of the network.
        boot: of this process.
        forged: called for the first, tenth, hundredth… request that does not match its sender, with the station.
    """

    def __init__(
        self,
        network: Exchange,
        context: BridgeContext,
        members: BridgeMembers,
        boot: int,
        forged: Callable[[str, str], None],
    ) -> None:
        self.members = members
        """Replaced when the network file is read again."""
        self.forgeries: Final[dict[str, int]] = {}
        """Number of each station's requests that did not match their sender."""
        self._network = network
        self._inside = network.here
        self._context = context
        self._loop, self._platform = context.loop, context.platform
        self._forged = forged
        self._server_boot = 0
        """Of the command interface server's present life."""
        self._holder = ""
        loop, platform = self._loop, self._platform
        self._publisher = Publisher(network, platform, "stations", boot)
        self._here: set[str] = set()
        self._undo = [
            *(network.subscribe(f"{platform}/ci/{kind}/*", self._receive) for kind in (COMMANDS, QUESTIONS)),
            network.subscribe(f"{platform}/{DEMANDS}/*", self._receive),
            network.watch(presence("*"), self._add_station),
            network.here.subscribe(f"{platform}/ci/summary", self._receive_summary),
            network.here.subscribe(f"{platform}/ci/control", self._receive_control),
        ]
        self._timer = loop.call_later(CONTACT_S, self._tick)

    def close(self) -> None:
        """Stops receiving."""
        self._timer.cancel()
        for end in self._undo:
            end()

    def _receive_summary(self, envelope: Envelope[Summary]) -> None:
        self._server_boot = envelope.source.boot

    def _receive_control(self, envelope: Envelope[ControlState]) -> None:
        self._holder = envelope.payload.holder

    def _receive(self, envelope: Envelope[Any]) -> None:
        _, *_, kind, station = envelope.topic.split("/")
        try:
            found = self._opened(envelope, station)
            reason = _wrong(found.payload, kind, station, self.members.roles.get(station))
            stale = self._stale(envelope.payload, found.payload)
            if kind == DEMANDS:
                reason = reason or stale
        except (Refused, WireError) as error:
            reason = str(error)
        if reason:
            number = self.forgeries[station] = self.forgeries.get(station, 0) + 1
            if number == 10 ** (len(str(number)) - 1):  # 1, 10, 100, …
                self._forged(station, reason if number == 1 else f"{reason} ({number} so far)")
            return
        if isinstance(found.payload, StationHeard):
            if not stale:
                self._publish_contact(station)
            return
        role = STATION_ROLES[self.members.roles[station]]
        request, topic = replace(found.payload, role=role, way=RELAYED, member=station), "velocity_demand"
        if kind != DEMANDS:
            request, topic = replace(request, objection=stale if kind == COMMANDS else ""), "ci/request"
        self._inside.publish(replace(found, topic=f"{self._platform}/{topic}", payload=request))

    def _opened(self, envelope: Envelope[Any], station: str) -> Envelope[Any]:
        """The message that a station has signed.

        Raises:
            Refused: it has not.
            WireError: what it has signed is no message.
        """
        if station not in self.members.roles:
            raise Refused(f"{station} is not a station of this network")
        if not isinstance(envelope.payload, SignedMessage):
            what = type(envelope.payload).__name__
            raise Refused(f"{what} is not a signed message: give the station the vehicle's version of gloc3")
        utc_s = self._context.clock.utc_s()
        return self.members.verifier.open(envelope, station, self._context.topics.types, utc_s)

    def _stale(self, signed: SignedMessage, message: Any) -> str:
        """Why a message is not for now; empty where it is."""
        if signed.boot == 0 or not signed.until_s > 0.0:
            return "it has no time limit, because the station has not heard the vehicle's clock yet; send it again"
        if signed.boot != self._server_boot:
            return "it is for an earlier start of the vehicle's command interface; send it again if it is still wanted"
        left_s = signed.until_s - self._loop.time()
        if not left_s >= 0.0:
            return f"it came {-left_s:.1f} s after its time limit; send it again if it is still wanted"
        clock = self._context.clock
        off_s = clock.utc_s() - signed.utc_s
        body = message.body if isinstance(message, CiRequest) else None
        is_hold = isinstance(body, Emergency) and body.verb is EmergencyVerb.HOLD  # the station's clock stops no hold
        if clock.is_utc_right() and not abs(off_s) <= MOST_AGE_S and not is_hold:
            return f"it was signed {off_s:.0f} s ago by the vehicle's clock, at most {MOST_AGE_S:.0f}: set the station's clock"
        return ""

    def _add_station(self, token: str, is_here: bool) -> None:
        station = token.rpartition("/")[2]
        if is_here and station in self.members.roles:
            self._here.add(station)
        else:
            self._here.discard(station)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(CONTACT_S, self._tick)
        for station in sorted(self._here - {self._holder}):  # that one signs its presence
            self._publish_contact(station)

    def _publish_contact(self, station: str) -> None:
        heard = StationHeard(station=station, member=station)
        self._publisher.publish(f"{self._platform}/ci/heard", heard, self._loop.time())


def _wrong(request: Any, kind: str, station: str, role: MemberRole | None) -> str:
    """Why a request is not what its key says; empty where it is."""
    if kind == QUESTIONS and isinstance(request, StationHeard):
        return "" if role in STATION_ROLES else f"{station} is not a station of this network"
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
