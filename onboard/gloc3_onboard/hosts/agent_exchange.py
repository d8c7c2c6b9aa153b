"""The exchange of a child process, whose main process takes the requests for its components and passes them on."""

from collections.abc import Callable
from typing import Any, Final

from gloc3.exchange.base import Deliver, Exchange, Unsubscribe
from gloc3.messages.envelope import Envelope

REQUESTS: Final = ("/command", "/function")


class AgentExchange:
    """An exchange that draws no requests from elsewhere: each comes once, by the pipe, whoever is there to take it.

    Args:
        exchange: everything else.
    """

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange

    @property
    def here(self) -> Exchange:
        """What passes inside this process."""
        return self._exchange.here

    def publish(self, envelope: Envelope[Any]) -> None:
        """Sends a message."""
        self._exchange.publish(envelope)

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for topics; for requests only as far as they come here."""
        exchange = self._exchange.here if pattern.endswith(REQUESTS) else self._exchange
        return exchange.subscribe(pattern, deliver)

    def declare_alive(self, token: str) -> Unsubscribe:
        """Says that something is here."""
        return self._exchange.declare_alive(token)

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that come and go."""
        return self._exchange.watch(pattern, changed)
