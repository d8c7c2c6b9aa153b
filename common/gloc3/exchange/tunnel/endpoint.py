"""One end of the command link over MAVLink TUNNEL, without I/O and without a clock (DESIGN §4, *mavlink*)."""

from __future__ import annotations

from typing import Any, Final

from gloc3.errors import Misuse, Refused
from gloc3.exchange.tunnel.body import ReliableBody, pack_reliable, unpack_reliable, unpack_status
from gloc3.exchange.tunnel.events import Acknowledged, Counters, Delivered, Happening, Undelivered
from gloc3.exchange.tunnel.frames import (
    MAX_NAME_BYTES,
    MAX_TOKENS,
    Ack,
    Data,
    OtherVersion,
    Refusal,
    Status,
    StatusPart,
    SummaryRows,
    TableRequest,
    TunnelFrame,
    TunnelHello,
    TunnelTable,
    decode,
)
from gloc3.exchange.tunnel.gate import NotAccepted, TunnelGate
from gloc3.exchange.tunnel.layout import MAX_PAYLOAD, PAYLOAD_TYPE, Lane, TunnelRole
from gloc3.exchange.tunnel.outbox import EVERYBODY, Outbox
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget, Pacer
from gloc3.exchange.tunnel.peers import Peer, TunnelPeers
from gloc3.exchange.tunnel.reader import TunnelFrameError
from gloc3.exchange.tunnel.routes import REQUEST_TIMEOUT_S, route, urgency
from gloc3.exchange.tunnel.sending import OutgoingMessage
from gloc3.exchange.tunnel.status import unpack_summary
from gloc3.exchange.tunnel.table import OwnTable
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.command_interface import CiReply, CiRequest
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import Summary
from gloc3.messages.topics import TopicTable
from gloc3.messages.watch import Sample, TopicActivity
from gloc3.messages.wire import VersionsDiffer, WireError

MAX_SENDERS: Final = 256
MAX_HOMELESS: Final = 32


class TunnelEndpoint:
    """A station or a platform on the link.

    Args:
        role: of this end.
        name: the platform's name, or the station's id such as `255`.
        own: its own address.
        boot: a random number (32 bits) for this start of the process.
        topics: the topics and types that this end knows.
        budget: the link's budget.
    """

    def __init__(
        self,
        role: TunnelRole,
        name: str,
        own: Address,
        boot: int,
        topics: TopicTable,
        budget: LinkBudget = RADIO,
    ) -> None:
        if not 0 < len(name.encode()) <= MAX_NAME_BYTES:
            raise Misuse(f"{name!r} is no name of 1 to {MAX_NAME_BYTES} bytes")
        self.role: Final = role
        self.name: Final = name
        self.own: Final = own
        self.boot: Final = boot & 0xFFFFFFFF
        self.counters: Final = Counters()
        self.topics: Final = topics
        self._gate = TunnelGate(role, name, topics)
        self._pacer = Pacer(budget)
        self._table = OwnTable()
        self._events: list[Happening] = []
        self._peers = TunnelPeers(role, name, own, self.counters, self._events.append)
        self._outbox = Outbox(role, name, self._pacer, self._peers, self._table, self.counters)
        self._published: dict[str, int] = {}
        self._homeless: list[tuple[Envelope[Any], float, float]] = []
        """Messages that wait for a receiver to appear: since when, and until when."""
        self._senders: dict[str, Address] = {}

    # --- from above ---

    def publish(self, envelope: Envelope[Any], now_s: float) -> None:
        """Sends a message if its topic crosses the link in this direction; others are none of its business."""
        platform, _, name = envelope.topic.partition("/")
        topic_route = route(name, self.topics.row(envelope.topic))
        if (
            topic_route is None
            or topic_route.sender is not self.role
            or (self.role is TunnelRole.PLATFORM and platform != self.name)
        ):
            return
        if topic_route.is_reliable:
            self._submit(envelope, now_s)
            return
        if topic_route.is_view and not self._viewers(envelope.payload):
            return  # who looks at it is on another link
        count = self._published.get(envelope.topic, 0)
        self._published[envelope.topic] = count + 1
        if count % topic_route.every == 0:
            try:
                (self._outbox.views if topic_route.is_view else self._outbox.status).offer(
                    self._number(envelope), envelope
                )
            except Refused as refusal:
                self._peers.problem(self.own, str(refusal))

    def declare(self, token: str) -> None:
        """Declares that something here is alive.

        Raises:
            Refused: too many tokens, or the token is too long.
        """
        if len(self._outbox.tokens) >= MAX_TOKENS:
            raise Refused(f"{MAX_TOKENS} tokens are alive already")
        size = len(self._table)
        number = self._table.token(token)
        if number == size:
            self._outbox.changes.append(number)
        if number not in self._outbox.tokens:
            self._outbox.tokens.append(number)
        self._outbox.send_hello_soon()

    def withdraw(self, token: str) -> None:
        """It is not alive any more."""
        number = self._table.token(token)
        if number in self._outbox.tokens:
            self._outbox.tokens.remove(number)
            self._outbox.send_hello_soon()

    def other_traffic(self, size_bytes: int, now_s: float) -> None:
        """Counts bytes that other programs have sent over the same link."""
        self._pacer.line.fill(now_s)
        self._pacer.line.spend(size_bytes)

    def peers(self) -> tuple[Peer, ...]:
        """All known peers, read-only."""
        return tuple(self._peers)

    # --- time ---

    def tick(self, now_s: float) -> None:
        """Does what is due: expires messages, repeats requests, detects silent peers."""
        self._peers.tick(now_s)
        for peer in self._peers:
            for outgoing, may_have_arrived in peer.sender.expire(now_s):
                self._give_up(outgoing.envelope, peer.address, not may_have_arrived, f"no answer from {peer.name}")
            peer.sender.probe(now_s)
        for entry in [entry for entry in self._homeless if now_s >= entry[2]]:
            self._homeless.remove(entry)
            envelope = entry[0]
            self._give_up(envelope, None, True, f"no known peer receives {envelope.topic}")

    def next_tick_s(self) -> float:
        """When `tick` and `outgoing` are to be called, unless something comes before."""
        times_s = [self._outbox.next_s()]
        times_s += [t_s for peer in self._peers if (t_s := peer.sender.next_s()) is not None]
        times_s += [until_s for *_, until_s in self._homeless]
        silent_s = self._peers.next_s()
        if silent_s is not None:
            times_s.append(silent_s)
        return min(times_s)

    def outgoing(self, now_s: float) -> list[tuple[int, int, bytes]]:
        """What may leave now: target system and component (0 for all), and the payload of a TUNNEL message."""
        pacer, counters, sent = self._pacer, self.counters, list[tuple[int, int, bytes]]()
        pacer.fill(now_s)
        pacer.set_busy(self._outbox.is_busy(now_s))
        while pacer.line.is_open and (chosen := self._outbox.choose(now_s)) is not None:
            target, frame, share = chosen
            payload = frame.encode(self.boot)
            size_bytes = pacer.spend(len(payload), share)
            counters.sent_frames += 1
            counters.sent_bytes += size_bytes
            if share is pacer.views:
                counters.view_bytes += size_bytes
            elif target is EVERYBODY:
                counters.status_bytes += size_bytes
            sent.append((target.system, target.component, payload))
        return sent

    def events(self) -> list[Happening]:
        """What has happened, in order; asking empties it."""
        events = list(self._events)
        self._events.clear()
        return events

    # --- from below ---

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a TUNNEL message; frames that are foreign, damaged or unknown are counted."""
        counters = self.counters
        size: int = message.payload_length
        if (
            message.payload_type != PAYLOAD_TYPE
            or message.target_system not in (0, self.own.system)
            or message.target_component not in (0, self.own.component)
        ):
            counters.foreign += 1
            return
        counters.received_frames += 1
        try:
            if size > MAX_PAYLOAD:
                raise TunnelFrameError(f"{size} bytes do not fit a frame")
            boot, frame = decode(message.payload[:size].ljust(size, b"\0"))
            self._dispatch(frame, boot, sender, now_s)
        except OtherVersion as difference:
            counters.other_version += 1
            self._peers.problem(sender, str(difference))
        except TunnelFrameError as error:
            counters.damaged += 1
            self._peers.problem(sender, str(error), kind="damaged")

    def _dispatch(self, frame: TunnelFrame, boot: int, sender: Address, now_s: float) -> None:
        if boot == self.boot and sender == self.own:
            self.counters.foreign += 1  # our own frame, sent back by a router
            return
        if isinstance(frame, TunnelHello):
            is_new = self._peers.find(sender, boot) is None
            greeted = self._peers.send_hello(sender, frame, boot, now_s)
            if greeted is not None and is_new:
                greeted.wanted = list(range(len(self._table)))
                self._outbox.send_hello_soon()
                self._clean_up(now_s)
            return
        peer = self._peers.find(sender, boot)
        if peer is None:
            self.counters.other_life += 1
            return
        self._peers.note_contact(peer, now_s)
        match frame:
            case Data() | Ack() | Refusal() if frame.to_boot != self.boot & 0xFFFF:
                self.counters.other_life += 1
                self._outbox.send_hello_soon()
            case Data():
                peer.receiver.receive(frame, now_s)
                self._hand_over(peer, frame.lane)
            case Ack():
                self._acknowledge(peer, frame, now_s)
            case Refusal():
                refused = peer.sender.refuse(frame.lane, frame.number)
                if refused is not None:
                    self._give_up(refused.envelope, sender, True, frame.reason)
            case Status() | StatusPart() | SummaryRows():
                self._receive_status(peer, frame)
            case TunnelTable():
                peer.table.add(frame.rows)
                self._peers.refresh(peer)
                for lane in Lane:
                    self._hand_over(peer, lane)
            case TableRequest():
                peer.wanted = [number for number in frame.numbers if number < len(self._table)]

    # --- reliable ---

    def _submit(self, envelope: Envelope[Any], now_s: float, since_s: float | None = None) -> None:
        """Sends a reliable message; its timeout runs from `since_s` if it has waited already."""
        since_s = now_s if since_s is None else since_s
        try:
            channel = self._number(envelope)
        except Refused as refusal:
            self._give_up(envelope, None, True, str(refusal))
            return
        receivers = self._receivers(envelope)
        if receivers is None and len(self._homeless) >= MAX_HOMELESS:
            self._give_up(envelope, None, True, f"{MAX_HOMELESS} messages already wait for a peer")
            return
        if receivers is None:
            timeout_s = urgency(envelope.payload, has_upload=False, is_fenced=False).timeout_s
            self._homeless.append((envelope, since_s, since_s + min(timeout_s, REQUEST_TIMEOUT_S)))
            return
        for peer in receivers:
            self._send(peer, envelope, channel, now_s, since_s)

    def _send(self, peer: Peer, envelope: Envelope[Any], channel: int, now_s: float, since_s: float) -> None:
        sender, payload = peer.sender, envelope.payload
        if isinstance(payload, CiRequest) and any(out.envelope.payload == payload for out, _ in sender.waiting()):
            self.counters.repeated_requests += 1
            return
        how = urgency(payload, has_upload=sender.is_open(Lane.BULK), is_fenced=sender.is_fenced)
        body = pack_reliable(envelope, channel, b"" if channel in peer.known else self._table.rows(channel))
        outgoing = OutgoingMessage(envelope, channel, body, how.lane, since_s, how.timeout_s, how.is_fence)
        reason = sender.submit(outgoing, now_s)
        if reason:
            self._give_up(envelope, peer.address, True, reason)

    def _receivers(self, envelope: Envelope[Any]) -> list[Peer] | None:
        """Receivers of a reliable message; None where its receiver is not known yet."""
        payload = envelope.payload
        if isinstance(payload, CiReply):
            address = self._senders.get(payload.sender)
            peer = self._peers.named(payload.sender) if address is None else self._peers.at(address)
        elif isinstance(payload, CiRequest):
            peer = self._peers.named(envelope.topic.partition("/")[0])
        elif isinstance(payload, Sample):
            return self._viewers(payload)
        else:
            return list(self._peers)
        return None if peer is None else [peer]

    def _viewers(self, payload: Sample | TopicActivity) -> list[Peer]:
        """Local viewers of a sample."""
        peers = (self._peers.named(name) for name in payload.stations)
        return [peer for peer in peers if peer is not None and peer.is_alive]

    def _clean_up(self, now_s: float) -> None:
        """Somebody new is here: perhaps a message waits for him."""
        waiting, self._homeless = self._homeless, []
        for entry in waiting:
            if self._receivers(entry[0]) is None:
                self._homeless.append(entry)
            else:
                self._submit(entry[0], now_s, entry[1])

    def _acknowledge(self, peer: Peer, ack: Ack, now_s: float) -> None:
        done, round_trip_s = peer.sender.acknowledge(ack, now_s)
        for outgoing in done:
            self.counters.acknowledged += 1
            peer.known.add(outgoing.channel)
            self._events.append(Acknowledged(outgoing.envelope, peer.address))
        if round_trip_s is not None:
            queue_s = peer.round_trips.sample(round_trip_s, now_s)
            self._pacer.fill(now_s)
            self._pacer.adapt(round_trip_s, queue_s, peer.round_trips.loss, now_s)

    def _hand_over(self, peer: Peer, lane: Lane) -> None:
        """Delivers the complete messages that are next in their lane."""
        while (body := peer.receiver.head(lane)) is not None:
            try:
                opened = unpack_reliable(body)
                if opened.row:
                    peer.table.add(opened.row)
                channel = peer.channel(opened.channel)
                if channel is None:
                    self.counters.unknown_number += 1
                    return
                envelope = self._gate.open(channel, peer, opened, is_reliable=True)
            except (TunnelFrameError, NotAccepted, WireError) as error:
                self._count(peer, error)
                peer.receiver.refuse(lane, str(error))
                return
            peer.receiver.done(lane)
            self._deliver(envelope, peer)

    # --- best effort ---

    def _receive_status(self, peer: Peer, frame: Status | StatusPart | SummaryRows) -> None:
        channel = peer.channel(frame.channel)
        if channel is None:
            self.counters.unknown_number += 1
            return
        if self.role is TunnelRole.PLATFORM and channel.topic.partition("/")[0] != self.name:
            return  # what a station tells another platform reaches all of them
        try:
            message_type = self._gate.type_of(channel, peer, is_reliable=False)
            if isinstance(frame, SummaryRows):
                if message_type is Summary and peer.status.receive_rows(frame.channel, frame.sequence, frame.body):
                    t_s, summary = unpack_summary(frame.body)
                    self._deliver(self._gate.envelope(channel, frame.sequence, t_s, summary), peer)
                return
            if isinstance(frame, StatusPart):
                body = peer.status.receive_part(frame)
            else:
                body = frame.body if peer.status.receive_whole(frame.channel, frame.sequence) else None
            if body is not None:
                t_s, payload = unpack_status(body)
                opened = ReliableBody(frame.channel, frame.sequence, t_s, payload)
                self._deliver(self._gate.open(channel, peer, opened, is_reliable=False), peer)
        except (NotAccepted, WireError) as error:
            self._count(peer, error)

    # --- both ---

    def _number(self, envelope: Envelope[Any]) -> int:
        size = len(self._table)
        number = self._table.channel(envelope)
        if number == size:
            self._outbox.changes.append(number)
        return number

    def _deliver(self, envelope: Envelope[Any], peer: Peer) -> None:
        self.counters.delivered += 1
        if isinstance(envelope.payload, CiRequest):
            self._learn(envelope.payload.sender, peer)
        self._events.append(Delivered(envelope, peer.address))

    def _learn(self, sender: str, peer: Peer) -> None:
        """Replies to this sender go where its requests come from."""
        if len(self._senders) > MAX_SENDERS:
            self._senders.clear()
        self._senders[sender] = peer.address

    def _count(self, peer: Peer, error: TunnelFrameError | NotAccepted | WireError) -> None:
        counters = self.counters
        if isinstance(error, TunnelFrameError):
            counters.damaged += 1
            self._peers.problem(peer.address, str(error), kind="damaged")
            return
        if isinstance(error, VersionsDiffer):
            counters.versions_differ += 1
        elif isinstance(error, NotAccepted):
            counters.not_accepted += 1
        else:
            counters.damaged += 1
        self._peers.problem(peer.address, str(error))

    def _give_up(self, envelope: Envelope[Any], peer: Address | None, is_certain: bool, reason: str) -> None:
        self.counters.undelivered += 1
        self._events.append(Undelivered(envelope, peer, is_certain, reason))
