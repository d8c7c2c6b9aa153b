"""Reports broken links and floods of requests."""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Frame
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3.mavlink.transport.endpoints import Endpoint
from gloc3.messages.envelope import Severity

POLL_AFTER_S: Final = 3.0
POLL_PERIOD_S: Final = 1.0


class LinkWatch:
    """Checks links regularly, and reports the problem of each once, and when it changes.

    Args:
        loop: the event loop.
        endpoints: endpoints of the links; more may be added.
        report: called with messages for people.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, endpoints: Sequence[Endpoint], report: Callable[[Severity, str], None]
    ) -> None:
        self._loop, self._endpoints, self._report = loop, endpoints, report
        self._reported: dict[str, str] = {}
        """Last reported problem of each link, by its URL."""
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        """Gives the links some time, then starts checking."""
        self._timer = self._loop.call_later(POLL_AFTER_S, self._poll)

    def close(self) -> None:
        """Looks no more."""
        if self._timer is not None:
            self._timer.cancel()

    def _poll(self) -> None:
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._poll)
        for endpoint in self._endpoints:
            problem = endpoint.intruder if endpoint.is_connected else endpoint.problem or "nothing is received there"
            if problem != self._reported.get(endpoint.url, ""):
                severity = Severity.ERROR if endpoint.intruder else Severity.WARNING if problem else Severity.NOTICE
                self._report(severity, f"{endpoint.url}: {problem or 'connected'}")
            self._reported[endpoint.url] = problem


MOST: Final = 5
"""Greatest number per second, so that a flood of requests causes no flood of replies."""
PERIOD_S: Final = 1.0


class RateWatch:
    """Tracks the message rates requested by stations.

    Args:
        changed: called when the autopilot's rates may have changed.
        now_s: returns the time.
    """

    def __init__(self, changed: Callable[[], None], now_s: Callable[[], float]) -> None:
        self._changed, self._now_s = changed, now_s
        self._began_s, self._reported = float("-inf"), 0
        self._stream_id = codec.shape("REQUEST_DATA_STREAM").id
        self._command_ids = frozenset(codec.shape(name).id for name in ("COMMAND_LONG", "COMMAND_INT"))

    def receive(self, frames: Iterable[Frame]) -> None:
        """Inspects frames of a station that the router forwards."""
        for frame in frames:
            if frame.message_id == self._stream_id or (frame.message_id in self._command_ids and _sets_a_rate(frame)):
                now_s = self._now_s()
                if now_s - self._began_s >= PERIOD_S:
                    self._began_s, self._reported = now_s, 0
                self._reported += 1
                if self._reported <= MOST:
                    self._changed()


def _sets_a_rate(frame: Frame) -> bool:
    message = frame.decode()
    return message is not None and message.command == SET_MESSAGE_INTERVAL
