"""One MAVLink link of the station, without its socket: this station's heartbeat, the command link, and frames."""

import asyncio
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.exchange.mavlink import MavlinkExchange, TunnelEndpoint, TunnelRole
from gloc3.exchange.tunnel.events import Happening, TunnelTrouble, Undelivered
from gloc3.exchange.tunnel.pacing import LinkBudget
from gloc3.mavlink.codec import Encoder, Frame, Parser, enums, shape
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.parser import HEADER_LENGTH
from gloc3.mavlink.router import Gaps
from gloc3.mavlink.services.heartbeat import Heartbeat, MavlinkPeer, MavlinkPeers
from gloc3.mavlink.signing import SignedOnly, Signing, timestamp
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.station_routes import NETWORK, StationRoute, StationRoutes

STATION_COMPONENT: Final = 190
MOST_LOCKED: Final = 16
"""Most systems for which it is reported that they sign and this link does not."""

Tap = Callable[[bytes], None]
"""Called with every raw frame of a link, in and out."""

ECHO_S: Final = 30.0
"""Age up to which a frame of ours that comes back is an echo, s: a router that has stalled brings it back late."""
DOUBLED_S: Final = 2.0
"""For how long frames in our name that are not ours have to come, with gaps no longer, until another station is reported, s."""
MOST_SENT: Final = 512
Report = Callable[[str], None]
"""Called with text about a link for users."""

GivenUp = Callable[[Undelivered], None]
"""Called with a message of the station that was given up."""


class SentFrames:
    """The frames that a station has sent within the last seconds: routers bring them back, by the same link or another."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, bytes]] = deque(maxlen=MOST_SENT)

    def add(self, data: bytes, now_s: float) -> None:
        """Notes a frame."""
        self._sent.append((now_s, _unsigned(data)))

    def has(self, data: bytes, now_s: float) -> bool:
        """Whether a received frame is one of them; it may be signed by another link."""
        unsigned = _unsigned(data)
        return any(one == unsigned and now_s - at_s <= ECHO_S for at_s, one in self._sent)


def _unsigned(data: bytes) -> bytes:
    """A frame's sequence, sender, message and payload."""
    return data[4 : HEADER_LENGTH + data[1]]


class LinkContext(msgspec.Struct, frozen=True, kw_only=True):
    """Context that all links of a station share."""

    loop: asyncio.AbstractEventLoop
    """Gives the time and wakes the links."""
    exchange: Exchange
    """The station's side; what crosses a link is joined to it."""
    topics: TopicTable
    """The topics that may cross."""
    boot: int
    """A random number for this start of the station."""
    system: int = 255
    """The station's MAVLink system, 255 and down."""
    name: str = ""
    """Name under which platforms know the station; empty for the number of its system."""
    report: Report = lambda _: None
    undelivered: GivenUp = lambda _: None
    """Called with messages that the command link has given up on all links that carried them."""
    tap: Tap = lambda _: None
    """Receives every frame, in and out."""
    forward: Callable[["StationLinkCore", Frame], None] = lambda _, __: None
    """Called with every genuine frame that a link receives, for other stations."""
    routes: StationRoutes = msgspec.field(default_factory=StationRoutes)
    """Which message goes by which link, and which has come by another already."""
    sent: SentFrames = msgspec.field(default_factory=SentFrames)
    """What has been sent on all links."""

    @property
    def own(self) -> Address:
        """Address of the station."""
        return Address(self.system, STATION_COMPONENT)


class LinkSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of one link."""

    url: str = ""
    """Used in reports; empty for a link that needs no name."""
    is_datagram: bool = True
    """Whether the bytes come in whole frames."""
    budget: LinkBudget = LinkBudget()
    """What the link carries."""
    rank: int = NETWORK
    """Rank of the route; see `station_routes`."""
    key: bytes | None = None
    """Signs all sent frames, and verifies all received ones; None for a link without signatures."""


class StationLinkCore:
    """One link without its socket: frames in and out, heartbeats, and platform discovery.

    Args:
        send: sends bytes on the link.
        context: shared with the other links of its station.
        settings: of this link.
    """

    def __init__(
        self,
        send: Callable[[bytes], None],
        context: LinkContext,
        settings: LinkSettings = LinkSettings(),  # noqa: B008 - immutable
    ) -> None:
        own, loop = context.own, context.loop
        self._loop, self._own, self._put, self._tap = loop, own, send, context.tap
        self._clock = Clock(loop)
        self._listeners: list[Callable[[Frame], None]] = []
        self._tunnel_id = shape("TUNNEL").id
        self._peers = MavlinkPeers(own)
        self._node = MavlinkComponent(own, [Heartbeat(own, vehicle_type=enums.MAV_TYPE_GCS), self._peers])
        self._has_reported_double = False
        self._doubled_s = (0.0, float("-inf"))
        """When frames in our name that are not ours began to come, and when the last one came."""
        self._locked: set[int] = set()
        self._gaps = Gaps()
        self._context, self._url = context, settings.url
        routes = context.routes
        route = self._route = routes.open(StationRoute(settings.rank, self.age_s))
        self._signing = None if settings.key is None else self._new_signing(settings.key)
        self._signed_only = None if self._signing is None else SignedOnly(self._signing, self._report)
        self._parser = Parser(is_datagram=settings.is_datagram)
        self._encoder = Encoder(*own, self._signing)
        self.frames_sent = 0
        end = TunnelEndpoint(
            TunnelRole.STATION, context.name or str(own.system), own, context.boot, context.topics, settings.budget
        )
        self._tunnel = MavlinkExchange(end, loop, self._send_message)
        self._tunnel.listen(self._on_event)
        self._part = self._tunnel.bridge(
            context.exchange,
            context.topics,
            inward=lambda envelope: envelope if routes.is_new(route, envelope) else None,
            outward=partial(routes.carries, route),
        )
        self._timer = loop.call_soon(self._tick)

    def _new_signing(self, key: bytes) -> Signing:
        clock = self._clock
        return Signing(key, link_id=self._route & 0xFF, now=timestamp(clock.utc_s()), is_clock_right=clock.is_utc_right)

    def receive(self, data: bytes) -> None:
        """Takes bytes from the link."""
        now_s = self._loop.time()
        for frame in self._parser.receive(data):
            self._tap(frame.raw)
            if self._signed_only is None:
                if frame.is_signed:
                    self._is_locked_out(frame)
            elif not self._signed_only.passes(frame, now_s):
                continue
            self._gaps.receive(frame)
            self._context.forward(self, frame)
            if frame.message_id == self._tunnel_id:
                message = frame.decode()
                if message is not None:
                    self._tunnel.receive(message, frame.sender)
            elif frame.sender == self._own:
                if not self._context.sent.has(frame.raw, now_s):
                    self._receive_double(now_s)
            else:
                self._node.receive(frame, now_s)
                for listener in tuple(self._listeners):
                    listener(frame)

    @property
    def frames_received(self) -> int:
        """Frames that came in."""
        return self._parser.frames_received

    @property
    def own(self) -> Address:
        """Address of the station on this link."""
        return self._own

    @property
    def autopilots(self) -> list[MavlinkPeer]:
        """Live autopilots on this link, in order of first contact."""
        return self._peers.autopilots

    def listen(self, listener: Callable[[Frame], None]) -> Unsubscribe:
        """Registers a listener for all received frames, except those of the command link."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message of the station's."""
        self._send_message(message)

    def forward(self, raw: bytes) -> None:
        """Sends a frame of another station as it is."""
        self._send(raw)

    def received(self) -> list[str]:
        """Names of live peers, from their heartbeats: `autopilot 1/1`, `system 1/191`."""
        return [
            f"{'autopilot' if peer.is_autopilot else 'system'} {peer.address.system}/{peer.address.component}"
            for peer in self._peers.alive
        ]

    @property
    def refused(self) -> int:
        """Frames that were dropped since their signature is missing or wrong."""
        return 0 if self._signing is None else self._signing.refused

    @property
    def refusals(self) -> dict[str, int]:
        """By reason, how many these are."""
        return {} if self._signed_only is None else self._signed_only.refused()

    @property
    def genuine(self) -> int:
        """Frames with a right signature."""
        return 0 if self._signed_only is None else self._signed_only.genuine

    @property
    def lost(self) -> int:
        """Frames that did not come here: lost, or left out before a slow line."""
        return self._gaps.lost

    def platforms(self) -> list[tuple[str, Address]]:
        """Platforms whose companions are received here, with the companions' addresses."""
        return [(peer.name, peer.address) for peer in self._tunnel.endpoint.peers() if peer.name]

    def round_trip_s(self, platform: str) -> float | None:
        """Round-trip time to a platform on this link, s; None where it is unknown."""
        return self._tunnel.round_trip_s(platform)

    def age_s(self, platform: str) -> float | None:
        """How long ago anything of the command link came from a platform here; None where nothing ever did."""
        return self._tunnel.received_age_s(platform)

    def close(self) -> None:
        """Stops sending and receiving."""
        self._timer.cancel()
        self._context.routes.close(self._route)
        self._part()
        self._tunnel.close()

    def _tick(self) -> None:
        now_s = self._loop.time()
        if self._signing is not None:
            self._signing.advance(timestamp(self._clock.utc_s()))
        self._node.tick(now_s)
        for message in self._node.outgoing():
            self._send_message(message)
        self._peers.events()
        next_s = self._node.next_tick_s()
        self._timer = self._loop.call_at(now_s + 1.0 if next_s is None else max(next_s, now_s + 1e-3), self._tick)

    def _send(self, data: bytes) -> None:
        self.frames_sent += 1
        self._context.sent.add(data, self._loop.time())
        self._tap(data)
        self._put(data)

    def _send_message(self, message: MavlinkMessage) -> None:
        self._send(self._encoder.encode(message))

    def _on_event(self, happening: Happening) -> None:
        if isinstance(happening, TunnelTrouble):
            self._report(happening.text)
        elif isinstance(happening, Undelivered) and self._context.routes.is_lost(self._route, happening):
            self._context.undelivered(happening)

    def _report(self, text: str) -> None:
        self._context.report(f"{self._url}: {text}" if self._url else text)

    def _is_locked_out(self, frame: Frame) -> None:
        """Reports a system that signs while this link has no key: it is received, but ignores this station."""
        if frame.system not in self._locked and len(self._locked) < MOST_LOCKED:
            self._locked.add(frame.system)
            who = f"{frame.system}/{frame.component}"
            self._report(
                f"{who} signs its messages, and this link has no key: it is heard, but ignores this station; "
                "see --signing-key"
            )

    def _receive_double(self, now_s: float) -> None:
        """Reports another station of our address, which sends heartbeats; not a burst of frames that were held up."""
        first_s, last_s = self._doubled_s
        self._doubled_s = first_s, _ = (now_s if now_s - last_s > DOUBLED_S else first_s), now_s
        if now_s - first_s >= DOUBLED_S and not self._has_reported_double:
            self._has_reported_double = True
            system = self._own.system
            self._report(f"another station is {system}, too; see --station-id")
