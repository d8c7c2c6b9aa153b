"""The autopilot's links: known peers, own messages, and forwarding between links."""

from collections.abc import Callable
from enum import StrEnum
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.tlog import SETUP_SIGNING

Send = Callable[[bytes], None]
Receive = Callable[[bytes], None]

_MOST_PEERS: Final = 64


class LinkKind(StrEnum):
    """Purposes of a link, which decide the rates at which telemetry begins."""

    GROUND = "ground"
    COMPANION = "companion"
    BARE = "bare"
    """Heartbeats and answers only."""


class AutopilotPort:
    """One link: parser, encoder with its own sequence, and known peers."""

    __slots__ = ("encoder", "is_datagram", "is_trusted", "kind", "parser", "peers", "send")

    def __init__(self, send: Send, own: Address, kind: LinkKind, *, is_datagram: bool) -> None:
        self.send: Final = send
        self.kind: Final = kind
        self.is_datagram: Final = is_datagram
        self.is_trusted = False
        """Whether unsigned frames are accepted although there is a key."""
        self.parser: Final = Parser(is_datagram=is_datagram)
        self.encoder: Final = Encoder(own.system, own.component)
        self.peers: dict[Address, None] = {}
        """Peers heard on this link, in order of arrival."""

    def reaches(self, system: int, component: int) -> bool:
        """Whether a peer with this address has been heard here; 0 matches any."""
        return any(system in (0, peer.system) and component in (0, peer.component) for peer in self.peers)

    def learn(self, sender: Address) -> None:
        """Registers a peer heard on this link."""
        if sender not in self.peers:
            if len(self.peers) >= _MOST_PEERS:
                del self.peers[next(iter(self.peers))]
            self.peers[sender] = None


class AutopilotRouter:
    """Routes frames to the autopilot and between links, by the rules of the MAVLink guide."""

    def __init__(
        self,
        own: Address,
        handle: Callable[[Frame], None],
        passes: Callable[[Frame, AutopilotPort], bool] = lambda *_: True,
    ) -> None:
        self.own: Final = own
        self.links: list[AutopilotPort] = []
        self._receive, self._passes = handle, passes

    def attach(self, send: Send, kind: LinkKind, *, is_datagram: bool) -> tuple[AutopilotPort, Receive]:
        """Adds a link; returns a callable for each piece of received data."""
        link = AutopilotPort(send, self.own, kind, is_datagram=is_datagram)
        self.links.append(link)

        def receive(data: bytes) -> None:
            for frame in link.parser.receive(data):
                if self._passes(frame, link):
                    self._route(frame, link)

        return link, receive

    def detach(self, link: AutopilotPort) -> None:
        """Takes a link away."""
        self.links.remove(link)

    def _route(self, frame: Frame, source: AutopilotPort) -> None:
        if frame.sender == self.own:
            return
        source.learn(frame.sender)
        system, component = frame.target_system, frame.target_component
        is_ours = system in (0, self.own.system) and component in (0, self.own.component)
        if is_ours:
            self._receive(frame)
        if (is_ours and system and component) or frame.message_id == SETUP_SIGNING:
            return
        for link in self.links:
            # Addressed frames go only where their target was heard; broadcasts go everywhere but back.
            if link is not source and (not system or link.reaches(system, component)):
                link.send(frame.raw)

    def send(self, message: MavlinkMessage) -> None:
        """Sends one of the autopilot's messages: to the target's link, or on all links."""
        shape = message.shape
        system = message.target_system if shape.target_system_at >= 0 and hasattr(message, "target_system") else 0
        component = message.target_component if system and shape.target_component_at >= 0 else 0
        targets = [link for link in self.links if link.reaches(system, component)] if system else []
        for link in targets or self.links:
            link.send(link.encoder.encode(message))


def message_id(name: str) -> int:
    """The number of a message."""
    return codec.shape(name).id


UARTS_FILE: Final = "@SYS/uarts.txt"
"""ArduPilot's file of its serial ports over MAVLink FTP."""
UARTS_BYTES: Final = 100_000
"""Size that ArduPilot reports for every file under `@SYS`, whatever its length."""


def uarts(links: list[AutopilotPort]) -> bytes:
    """The content of ArduPilot's `@SYS/uarts.txt`: a line for each link."""
    lines = [f"SERIAL{number} {link.kind} PEERS={len(link.peers)}" for number, link in enumerate(links)]
    return "\n".join(("UARTV1", *lines, "")).encode()
