"""Sends one topic over Zenoh, with the quality of service of its row."""

from __future__ import annotations

from typing import Any, Final

import zenoh

from gloc3.exchange.channel import Means, TopicChannel
from gloc3.exchange.large import LARGE, LargeOutlet
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.topics import TopicRow, TopicService

LATCHED: Final = "latched"
"""Level of a token's name, after the platform's."""
UNKNOWN: Final = TopicRow(Message, service=TopicService.REPORT)
"""For undeclared topics."""


class TopicOutlet:
    """Sends one topic while it has a remote subscriber, or while that is not known yet."""

    def __init__(self, means: Means, topic: str, row: TopicRow) -> None:
        self._topic, self._means = topic, means
        self._channel = TopicChannel(means, topic, row.travels)
        self._is_bulk = row.travels is TopicService.BULK and not row.is_latched
        self._large: LargeOutlet | None = None
        self.last: Envelope[Any] | None = None
        """Of a latched topic, the last message."""
        self._held: tuple[Any, ...] = ()
        if row.is_latched:
            self._held = (
                means.session.declare_queryable(topic, self._answer, allowed_origin=zenoh.Locality.REMOTE),
                means.session.liveliness().declare_token(latched_token(topic)),
            )

    def send(self, envelope: Envelope[Any]) -> str:
        """Sends a message directly or as a large one; returns why it was dropped here, or an empty text."""
        if self._held:
            self.last = envelope
        if not self._channel.is_wanted:
            return ""
        types = self._means.types
        apart = types.encode_apart(envelope)
        head, body = (None, types.encode(envelope)) if apart is None else apart
        if self._is_bulk and len(body) >= LARGE and self._means.near is not None:
            if self._large is None:
                self._large = LargeOutlet(self._means, self._means.near, self._topic)
            reason = self._large.send(head, body)
            if self._large.is_settled:
                return reason
        return self._channel.put(body, head)

    def close(self) -> None:
        """Looks no more."""
        self._channel.close()
        if self._large is not None:
            self._large.close()

    def _answer(self, query: zenoh.Query) -> None:
        """Handles a late subscriber's query for the last message, in a thread of Zenoh."""
        with query:
            if self.last is not None:
                query.reply(self._topic, self._means.types.encode(self.last))


def latched_token(topic: str) -> str:
    """The token by which others see that a latched topic has a last message; of a pattern, the pattern of tokens."""
    platform, _, name = topic.partition("/")
    return f"*/{LATCHED}/**" if platform == "**" else f"{platform}/{LATCHED}/{name}"
