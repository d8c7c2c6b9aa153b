"""Tells of links that lead nowhere."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Final

from gloc3.mavlink.transport.endpoints import Endpoint
from gloc3.messages.envelope import Severity

LOOK_AFTER_S: Final = 3.0
LOOK_EVERY_S: Final = 1.0


class LinkWatch:
    """Looks at links now and then, and tells what is wrong with one, once, and when that changes.

    Args:
        loop: in which it looks.
        endpoints: the links' ends; more may come.
        say: takes what a person should know.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, endpoints: Sequence[Endpoint], say: Callable[[Severity, str], None]
    ) -> None:
        self._loop, self._endpoints, self._say = loop, endpoints, say
        self._told: dict[str, str] = {}
        """What was told last of each link, by its URL."""
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        """Gives the links some time, then looks."""
        self._timer = self._loop.call_later(LOOK_AFTER_S, self._look)

    def close(self) -> None:
        """Looks no more."""
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        self._timer = self._loop.call_later(LOOK_EVERY_S, self._look)
        for endpoint in self._endpoints:
            problem = "" if endpoint.is_connected else endpoint.problem or "nothing is heard there"
            if problem != self._told.get(endpoint.url, ""):
                self._say(Severity.WARNING if problem else Severity.NOTICE, f"{endpoint.url}: {problem or 'connected'}")
            self._told[endpoint.url] = problem
