"""Filter of messages from a peer: known topics in the right direction, of a type common to both ends."""

from __future__ import annotations

from typing import Any

from gloc3.errors import Gloc3Error
from gloc3.exchange.tunnel.body import ReliableBody, unpack_payload
from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.exchange.tunnel.peers import Peer
from gloc3.exchange.tunnel.routes import route
from gloc3.exchange.tunnel.table import TunnelChannel
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import VersionsDiffer, WireError


class NotAccepted(Gloc3Error):
    """A message on a topic that this end does not accept from that peer; the text gives the reason."""


class TunnelGate:
    """Accepts or rejects channels, and decodes their messages.

    Args:
        role: of this end.
        name: of this platform; a station accepts from every platform only that platform's own topics.
        topics: the topics and types that this end knows.
    """

    def __init__(self, role: TunnelRole, name: str, topics: TopicTable) -> None:
        self._role = role
        self._name = name
        self._topics = topics

    def type_of(self, channel: TunnelChannel, peer: Peer, *, is_reliable: bool) -> type[Message]:
        """Message type of a channel.

        Raises:
            NotAccepted: this end does not accept the topic from that peer.
            VersionsDiffer: the fixed parts of the type differ between the ends.
            WireError: this end does not know the type.
        """
        platform, _, name = channel.topic.partition("/")
        row = self._topics.row(channel.topic)
        topic_route = route(name, row)
        expected = self._name if self._role is TunnelRole.PLATFORM else peer.name
        if (
            row is None
            or topic_route is None
            or topic_route.sender is not peer.role
            or topic_route.is_reliable is not is_reliable
        ):
            raise NotAccepted(f"{channel.topic} is not accepted from a {peer.role.name.lower()}")
        if platform != expected:
            raise NotAccepted(f"{channel.topic} is not accepted from {peer.name}: it belongs to {platform}")
        found = self._topics.types.find(channel.type)
        if found is not row.message:
            raise NotAccepted(f"{channel.topic} carries {row.message.__name__}, not {found.__name__}")
        return found

    def open(self, channel: TunnelChannel, peer: Peer, body: ReliableBody, *, is_reliable: bool) -> Envelope[Any]:
        """Decodes a message of a channel into its envelope.

        Raises:
            NotAccepted, VersionsDiffer, WireError: as `type_of`.
            FrameError: the payload is damaged.
        """
        message_type = self.type_of(channel, peer, is_reliable=is_reliable)
        payload = unpack_payload(body.payload, message_type)
        return self.envelope(channel, body.sequence, body.t_s, payload)

    @staticmethod
    def envelope(channel: TunnelChannel, sequence: int, t_s: float, payload: Any) -> Envelope[Any]:
        """The envelope, as it was published."""
        if channel.source is None:
            raise WireError(f"{channel.topic} is not a topic")
        return Envelope(channel.topic, channel.source, sequence, t_s, channel.frame, channel.type, payload)


__all__ = ["NotAccepted", "TunnelGate", "VersionsDiffer"]
