"""The platform's time on other hosts than the clock host: requested over the exchange, and followed."""

import asyncio
from collections.abc import Callable
from secrets import randbits
from typing import Any, Final

from gloc3.clock import monotonic_s
from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.hosts import HOSTS, ClockAnswer, ClockQuestion
from gloc3_onboard.hosts.offset import OffsetEstimate, OffsetFilter

FIRST: Final = 12
"""Answers before the components begin."""
FIRST_EVERY_S: Final = 0.05
THEN_EVERY_S: Final = 1.0
STEP_S: Final = 0.2
"""A difference that is not followed: the clock host was rebooted."""


class ClockServer:
    """Time server on the clock host, for the other hosts.

    Args:
        exchange: exchange of the main process.
        platform: the platform's name.
        loop: event loop with the platform's time.
    """

    def __init__(self, exchange: Exchange, platform: str, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._publisher = Publisher(exchange, platform, "clock", randbits(32))
        self._end = exchange.subscribe(f"{platform}/{HOSTS}/*/clock", self._handle_question)

    def close(self) -> None:
        """Answers nothing any more."""
        self._end()

    def _handle_question(self, envelope: Envelope[Any]) -> None:
        received_s = self._loop.time()
        question = envelope.payload
        if isinstance(question, ClockQuestion):
            answer = ClockAnswer(number=question.number, received_s=received_s, answered_s=self._loop.time())
            self._publisher.publish(f"{envelope.topic}_answer", answer, received_s)


class HostClock:
    """Requests the clock host's time, often at first and then once a second.

    Args:
        exchange: exchange of the main process.
        platform: the platform's name.
        host: name of this host.
        loop: the process's event loop.
        changed: called with the state after each answer.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: str,
        host: str,
        loop: asyncio.AbstractEventLoop,
        changed: Callable[[OffsetEstimate], None],
    ) -> None:
        self._loop, self._changed = loop, changed
        self._topic = f"{platform}/{HOSTS}/{host}/clock"
        self._publisher = Publisher(exchange, platform, f"host_{host}", randbits(32))
        self._end = exchange.subscribe(f"{self._topic}_answer", self._handle_answer)
        self._filter = OffsetFilter()
        self._requested: dict[int, float] = {}
        self._timer = loop.call_soon(self._send_question)

    def estimate(self) -> OffsetEstimate:
        """What is known now."""
        return self._filter.estimate(monotonic_s())

    @property
    def has_settled(self) -> bool:
        """Whether enough is known for the components to begin."""
        return len(self._filter) >= FIRST

    def close(self) -> None:
        """Asks no more."""
        self._timer.cancel()
        self._end()

    def _send_question(self) -> None:
        period_s = THEN_EVERY_S if self.has_settled else FIRST_EVERY_S
        self._timer = self._loop.call_later(period_s, self._send_question)
        number = randbits(32)
        while len(self._requested) > FIRST:
            del self._requested[next(iter(self._requested))]
        self._requested[number] = monotonic_s()
        self._publisher.publish(self._topic, ClockQuestion(number=number), self._loop.time())

    def _handle_answer(self, envelope: Envelope[Any]) -> None:
        received_s, answer = monotonic_s(), envelope.payload
        requested_s = self._requested.pop(answer.number, None) if isinstance(answer, ClockAnswer) else None
        if requested_s is not None:
            self._filter.add(requested_s, answer.received_s, answer.answered_s, received_s)
            self._changed(self._filter.estimate(received_s))
