"""One MAVLink link of the station, without its socket: one heartbeat of ours, the command link, and frames in and out."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

from gloc3.clock import Clock
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.exchange.mavlink import MavlinkExchange, Role, TunnelEndpoint
from gloc3.exchange.tunnel.happenings import Happening, Trouble, Undelivered
from gloc3.exchange.tunnel.pacing import LinkBudget
from gloc3.link.codec import Encoder, Frame, Parser, enums, shape
from gloc3.link.gaps import Gaps
from gloc3.link.heartbeat import Heartbeat, Peer, Peers
from gloc3.link.message import Address, MavlinkMessage
from gloc3.link.node import Node
from gloc3.link.signed_only import SignedOnly
from gloc3.link.signing import Signing, timestamp
from gloc3.messages import Envelope
from gloc3.topics import TopicTable

STATION_COMPONENT: Final = 190
MOST_LOCKED: Final = 16
"""Of so many systems it is told that they sign and we do not."""

Tap = Callable[[bytes], None]
"""Is given every frame of a link, in and out, as it is."""

Told = Callable[[str], None]
"""Is told in words what a person should know of a link."""

GivenUp = Callable[[Undelivered], None]
"""Is told which message of the station's was given up."""


class Link:
    """One link: frames in and out, without the socket."""

    def __init__(
        self,
        send: Callable[[bytes], None],
        *,
        loop: asyncio.AbstractEventLoop,
        exchange: Exchange,
        topics: TopicTable,
        system: int,
        boot: int,
        told: Told,
        name: str = "",
        undelivered: GivenUp = lambda _: None,
        is_datagram: bool = True,
        budget: LinkBudget | None = None,
        signing: Signing | None = None,
        tap: Tap = lambda _: None,
        carries: Callable[[Envelope[Any]], bool] = lambda _: True,
        is_new: Callable[[Envelope[Any]], bool] = lambda _: True,
    ) -> None:
        """Begins to send heartbeats and to look for platforms.

        Args:
            send: puts bytes on the link.
            loop: gives the time and wakes the link.
            exchange: the station's side; what crosses the link is joined to it.
            topics: the topics that may cross.
            system: the station's MAVLink system, 255 and down.
            name: under which platforms know the station; empty for the number of its system.
            boot: a random number for this start of the station.
            told: is told what a person should know.
            undelivered: is told what the command link has given up here.
            is_datagram: whether the bytes come in whole frames.
            budget: what the link carries.
            signing: signs all that is sent, and judges all that is heard; None on a link without a key.
            tap: is given every frame, in and out.
            carries: tells whether a message of the station's goes by this link.
            is_new: tells whether a message of the command link has not come by another link already.
        """
        own = Address(system, STATION_COMPONENT)
        self._loop = loop
        self._signing = signing
        self._clock = Clock(loop)
        self._listeners: list[Callable[[Frame], None]] = []
        self._put = send
        self._tap = tap
        self._told = told
        self._undelivered = undelivered
        self._tunnel_id = shape("TUNNEL").id
        self._parser = Parser(is_datagram=is_datagram)
        self._encoder = Encoder(*own, signing)
        self.frames_sent = 0
        self._peers = Peers(own)
        self._node = Node(own, [Heartbeat(own, vehicle_type=enums.MAV_TYPE_GCS), self._peers])
        self._own = own
        self._has_told_of_double = False
        self._locked: set[int] = set()
        self._gaps = Gaps()
        self._signed_only = None if signing is None else SignedOnly(signing, told)
        end = TunnelEndpoint(Role.STATION, name or str(system), own, boot, topics, budget or LinkBudget())
        self._tunnel = MavlinkExchange(end, loop, self._send_message)
        self._tunnel.listen(self._happened)
        self._part = self._tunnel.bridge(
            exchange, topics, inward=lambda envelope: envelope if is_new(envelope) else None, outward=carries
        )
        self._timer = loop.call_soon(self._tick)

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
            self._gaps.hear(frame)
            if frame.message_id == self._tunnel_id:
                message = frame.decode()
                if message is not None:
                    self._tunnel.receive(message, frame.sender)
            elif frame.sender == self._own:
                self._is_doubled()
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
        """As whom the station speaks here."""
        return self._own

    @property
    def autopilots(self) -> list[Peer]:
        """The autopilots that are heard here now, in the order in which they came."""
        return self._peers.autopilots

    def listen(self, listener: Callable[[Frame], None]) -> Unsubscribe:
        """Is told every frame of others that comes, those of the command link excepted."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message of the station's."""
        self._send_message(message)

    def forward(self, frame: Frame) -> None:
        """Sends a frame that a library behind this link has made in the station's name."""
        self._send(self._encoder.forward(frame))

    def heard(self) -> list[str]:
        """Who is there, told by their heartbeats: `autopilot 1/1`, `system 1/191`."""
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
        """The platforms whose companions are heard here, with the companions' addresses."""
        return [(peer.name, peer.address) for peer in self._tunnel.endpoint.peers() if peer.name]

    def round_trip_s(self, platform: str) -> float | None:
        """How long something to a platform and its answer are on their way here; None where that is not known."""
        return self._tunnel.round_trip_s(platform)

    def age_s(self, platform: str) -> float | None:
        """How long ago anything of the command link came from a platform here; None where nothing ever did."""
        return self._tunnel.heard_age_s(platform)

    def close(self) -> None:
        """Sends and hears nothing more."""
        self._timer.cancel()
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
        self._tap(data)
        self._put(data)

    def _send_message(self, message: MavlinkMessage) -> None:
        self._send(self._encoder.encode(message))

    def _happened(self, happening: Happening) -> None:
        if isinstance(happening, Trouble):
            self._told(happening.text)
        elif isinstance(happening, Undelivered):
            self._undelivered(happening)

    def _is_locked_out(self, frame: Frame) -> None:
        """Who signs takes nothing that is not signed: without a key an operator sees it, and is not heard."""
        if frame.system not in self._locked and len(self._locked) < MOST_LOCKED:
            self._locked.add(frame.system)
            who = f"{frame.system}/{frame.component}"
            self._told(
                f"{who} signs what it sends, and this link has no key: it is seen, but takes nothing from here; "
                "see --signing-key"
            )

    def _is_doubled(self) -> None:
        if not self._has_told_of_double:
            self._has_told_of_double = True
            system = self._own.system
            self._told(f"somebody else is station {system}, or the link sends back what we send; see --station-id")
