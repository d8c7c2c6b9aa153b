"""A MAVLink link to stations: our exchanger's topics in TUNNEL frames, and the heartbeat of component 191."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any, Final, NamedTuple

from msgspec.structs import replace

from gloc3.clock import Clock
from gloc3.component.supervision import HEARTBEAT_STATE
from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.exchange.mavlink import MavlinkExchange
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.events import Happening, TunnelTrouble
from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Address, Encoder, Frame, MavlinkMessage
from gloc3.mavlink.services.heartbeat import AUTOPILOT_INVALID, GROUND_STATION
from gloc3.mavlink.signing import SignedOnly, Signing, timestamp
from gloc3.messages.command_interface import CiRequest, StationRole
from gloc3.messages.envelope import Envelope, Event, Severity
from gloc3.messages.summaries import CiEvent, Health, StationHeard, Summary
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.topics import TopicTable
from gloc3_onboard.autopilot.link import COMPANION, FrameLink

CONTACT_PERIOD_S: Final = 0.5
NO_STATION_S: Final = 6.0
"""Time without a station after which none counts as present, s; longer than the server's limit for contact."""
ONBOARD_CONTROLLER: Final = 18


def heartbeat(health: Health) -> MavlinkMessage:
    """Heartbeat with the platform's health; the custom mode distinguishes quiet from working and absent from faulty."""
    return codec.message(
        "HEARTBEAT",
        type=ONBOARD_CONTROLLER,
        autopilot=AUTOPILOT_INVALID,
        system_status=HEARTBEAT_STATE[health],
        custom_mode=list(Health).index(health),
        mavlink_version=3,
    )


class HeartbeatSource:
    """Sends a heartbeat once a second, from the summaries of the supervised work: without these there is none."""

    def __init__(
        self, exchange: Exchange, platform: str, sends: Callable[[], list[Callable[[MavlinkMessage], None]]]
    ) -> None:
        self._sends = sends
        self._sent_s = float("-inf")
        self._health: Health | None = None
        self._unsubscribe = exchange.subscribe(f"{platform}/ci/summary", self._receive_summary)

    def close(self) -> None:
        """Sends none any more."""
        self._unsubscribe()

    def _receive_summary(self, envelope: Envelope[Summary]) -> None:
        health = envelope.payload.health
        if envelope.t_s - self._sent_s < 0.99 and health is self._health:
            return
        self._sent_s, self._health = envelope.t_s, health
        message = heartbeat(health)
        for send in self._sends():
            send(message)


class StationLinkSettings(NamedTuple):
    """Settings of a link to stations."""

    budget: LinkBudget = RADIO
    """What the link carries."""
    signing: Signing | None = None
    """Signs all sent frames and verifies all received ones; None without a key."""
    role: StationRole = StationRole.OPERATOR
    """Role of all stations on the link."""
    name: str = ""
    """What the link is called in the record of commands."""
    member: str = ""
    """Member of the network whose rights all stations on the link have."""


class StationLink:
    """One link, with any number of stations on it.

    Args:
        platform: the platform's name.
        system_id: MAVLink system of the vehicle.
        loop: the process's loop.
        exchange: the platform's middleware.
        topics: known topics.
        boot: random number of this start of the process.
        settings: settings of the link.
    """

    def __init__(
        self,
        platform: str,
        system_id: int,
        loop: asyncio.AbstractEventLoop,
        exchange: Exchange,
        topics: TopicTable,
        boot: int,
        settings: StationLinkSettings = StationLinkSettings(),  # noqa: B008 - immutable
    ) -> None:
        signing, budget, name = settings.signing, settings.budget, settings.name
        self._loop = loop
        self._role, self._route = settings.role, f"{name}, signed" if signing is not None else name
        self._signing, self._member, self._system = signing, settings.member, system_id
        self.signed_only: Final = None if signing is None else SignedOnly(signing, self._warn)
        """Accepts or rejects received frames; None without a key."""
        self._clock = Clock(loop)
        self._link: FrameLink | None = None
        own = Address(system_id, COMPANION)
        self._encoders = {COMPANION: Encoder(*own, signing)}
        """By component of the vehicle."""
        tunnel = TunnelEndpoint(TunnelRole.PLATFORM, platform, own, boot, topics, budget)
        self._exchange = MavlinkExchange(tunnel, loop, self.send)
        self._tunnel_id = codec.shape("TUNNEL").id
        self._heartbeat_id = codec.shape("HEARTBEAT").id
        self._part = self._exchange.bridge(exchange, topics, platform, self._marked, self._leaves)
        self._withdraw = self._exchange.declare_alive(platform)
        self._publisher = Publisher(exchange, platform, "station_link", boot)
        self._contact_topic = f"{platform}/ci/heard"
        self._received_s: dict[str, float] = {}
        self._reached: frozenset[str] = frozenset()
        """Stations reached by published messages."""
        self._event_topic = f"{platform}/components/station_link/event"
        self._exchange.listen(self._on_event)

    def open(self, link: FrameLink) -> None:
        """Starts sending on a link, whose owner passes received frames to `receive_frames`."""
        self._link = link

    def close(self) -> None:
        """Stops sending."""
        self._part()
        self._exchange.close()
        self._link = None

    def send(self, message: MavlinkMessage, component: int = COMPANION) -> None:
        """Sends one message as the companion, or as another component of this process."""
        if self._link is not None:
            if self._signing is not None:
                self._signing.advance(timestamp(self._clock.utc_s()))
            encoder = self._encoders.get(component)
            if encoder is None:
                encoder = self._encoders[component] = Encoder(self._system, component, self._signing)
            self._link.send(encoder.frame(message))

    def receive_frames(self, frames: Iterable[Frame]) -> None:
        """Handles frames of the link, whose signatures have been verified."""
        for frame in frames:
            if frame.message_id == self._tunnel_id:
                message = frame.decode()
                if message is not None:
                    self._note_station(frame.sender)
                    self._exchange.receive(message, frame.sender)
            elif frame.message_id == self._heartbeat_id:
                message = frame.decode()
                if message is not None and message.type == GROUND_STATION:
                    self._note_station(frame.sender)

    def _marked(self, envelope: Envelope[Any]) -> Envelope[Any]:
        """A request marked with its link and its sender's permissions."""
        if not isinstance(envelope.payload, CiRequest | VelocityDemand):
            return envelope
        request = replace(envelope.payload, role=self._role, way=self._route, member=self._member)
        return replace(envelope, payload=request)

    def _leaves(self, envelope: Envelope[Any]) -> bool:
        """Whether an event is sent now; during a silence it waits for the next contact."""
        if not isinstance(envelope.payload, CiEvent):
            return True
        return self._loop.time() - max(self._received_s.values(), default=float("-inf")) < NO_STATION_S

    def _on_event(self, happening: Happening) -> None:
        """Publishes a link event as any other event: logged, and sent to stations."""
        if isinstance(happening, TunnelTrouble):
            self._warn(happening.text)

    def _warn(self, text: str) -> None:
        event = Event(severity=Severity.WARNING, text=text)
        self._publisher.publish(self._event_topic, event, self._loop.time())

    def _note_station(self, sender: Address) -> None:
        """Registers a station by its own name, or by its MAVLink system until it sends one."""
        peers = self._exchange.endpoint.peers()
        now_s, peer = self._loop.time(), next((p for p in peers if p.address == sender), None)
        station, is_reached = (str(sender.system), False) if peer is None else (peer.name, peer.is_alive)
        is_new = is_reached and station not in self._reached
        if is_new or now_s - self._received_s.get(station, float("-inf")) >= CONTACT_PERIOD_S:
            self._received_s[station] = now_s
            self._reached = self._reached | {station} if is_reached else self._reached - {station}
            received = StationHeard(station=station, is_reached=is_reached, member=self._member, role=self._role)
            self._publisher.publish(self._contact_topic, received, now_s)
