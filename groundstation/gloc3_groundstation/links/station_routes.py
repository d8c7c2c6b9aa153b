"""Several routes to one platform, such as Wi-Fi and a radio: route selection and duplicate removal."""

from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec

from gloc3.exchange.tunnel.events import Undelivered
from gloc3.messages.command_interface import CiRequest, Emergency, Query
from gloc3.messages.envelope import Envelope

OWN_NETWORK, NETWORK, LINE = range(3)
"""Rank of a route: the network of platforms and stations; MAVLink over a network; a radio or another line."""
FRESH_S: Final = 2.5
"""Age of a platform's last message up to which a route leads to it, s; each route has two a second."""
MAX_REMEMBERED: Final = 4096
"""Messages whose first route, or whose routes, are remembered."""

V = TypeVar("V")
Key = tuple[str, int, int]
"""A message: its topic, its source's boot, its sequence."""


class StationRoute(msgspec.Struct, frozen=True):
    """One route."""

    rank: int
    """`OWN_NETWORK`, `NETWORK` or `LINE`; of two that lead to a platform the lower one is taken."""
    age_s: Callable[[str], float | None]
    """Age of a platform's last message on this route, s; None before the first."""


class StationRoutes:
    """All routes of a station, by number.

    A request is sent on the best route that leads to its platform now. Messages after a possible loss (a query for a
    request's outcome, a repeat), and every emergency, are sent on all routes: a platform executes a request once,
    however often it arrives.
    """

    def __init__(self) -> None:
        self._routes: dict[int, StationRoute] = {}
        self._count = 0
        self._carriers: dict[Key, frozenset[int]] = {}
        self._sent: dict[Key, None] = {}
        self._came: dict[Key, int] = {}
        self._certain: dict[Key, set[int]] = {}

    def open(self, route: StationRoute) -> int:
        """Adds a route; returns its number."""
        self._count += 1
        self._routes[self._count] = route
        return self._count

    def close(self, number: int) -> None:
        """Removes a route."""
        self._routes.pop(number, None)

    def carries(self, number: int, envelope: Envelope[Any]) -> bool:
        """Whether a message of the station is sent on this route."""
        if len(self._routes) < 2:
            return True
        key = _key(envelope)
        if key not in self._carriers:
            _remember(self._carriers, key, self._choose(envelope))
        return number in self._carriers[key]

    def is_new(self, number: int, envelope: Envelope[Any]) -> bool:
        """Whether a message received on this route has not been received on another one."""
        if len(self._routes) < 2:
            return True
        return _remember(self._came, _key(envelope), number) == number

    def is_lost(self, number: int, lost: Undelivered) -> bool:
        """Whether a message that a route could not deliver counts as undelivered.

        It certainly does only when all routes that carried it have given it up; one that may have arrived is reported
        at once.
        """
        if not lost.is_certain:
            return True
        key = _key(lost.envelope)
        carriers = self._carriers.get(key, frozenset(self._routes)) & self._routes.keys()
        text = _remember(self._certain, key, set())
        text.add(number)
        if not carriers <= text:
            return False
        del self._certain[key]
        return True

    def _choose(self, envelope: Envelope[Any]) -> frozenset[int]:
        platform, request = envelope.topic.partition("/")[0], envelope.payload
        leading = {
            n: route
            for n, route in self._routes.items()
            if (age_s := route.age_s(platform)) is not None and age_s < FRESH_S
        }
        if not leading or not isinstance(request, CiRequest) or isinstance(request.body, Emergency | Query):
            return frozenset(self._routes)
        requested = (envelope.topic, request.boot, request.sequence)
        if requested in self._sent:
            return frozenset(self._routes)
        _remember(self._sent, requested, None)
        return frozenset([min(leading, key=lambda number: (leading[number].rank, number))])


def _key(envelope: Envelope[Any]) -> Key:
    return envelope.topic, envelope.source.boot, envelope.sequence


def _remember(memory: dict[Key, V], key: Key, value: V) -> V:
    """Stores a value for a new message and returns the stored value; the oldest entries are dropped."""
    known = memory.setdefault(key, value)
    if len(memory) > MAX_REMEMBERED:
        del memory[next(iter(memory))]
    return known
