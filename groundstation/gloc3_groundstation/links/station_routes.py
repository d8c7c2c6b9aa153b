"""Several routes to one platform, such as Wi-Fi and a radio: route selection and duplicate removal."""

from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec

from gloc3.exchange.tunnel.events import Undelivered
from gloc3.messages.command_interface import CiRequest, Emergency, Query
from gloc3.messages.envelope import Envelope

OWN_NETWORK, NETWORK, LINE = range(3)
"""How good a way is: a network of platforms and stations of their own; MAVLink over a network; a radio or another line."""
FRESH_S: Final = 2.5
"""A way by which a platform was heard so lately leads there now; it tells of itself twice a second."""
MAX_REMEMBERED: Final = 4096
"""Messages of which it is known by which way they came first, or went."""

V = TypeVar("V")
Key = tuple[str, int, int]
"""A message: its topic, its source's boot, its sequence."""


class StationRoute(msgspec.Struct, frozen=True):
    """One route."""

    rank: int
    """`OWN_NETWORK`, `NETWORK` or `LINE`; of two that lead to a platform the lower one is taken."""
    age_s: Callable[[str], float | None]
    """How long ago anything came from a platform by this way; None where nothing ever did."""


class StationRoutes:
    """All routes of a station, by number.

    A request goes by the best way that leads to its platform now. What may have been lost on it (a question what became of
    a request, a repeat), and every emergency, goes by all: a platform carries a request out once, however it comes.
    """

    def __init__(self) -> None:
        self._routes: dict[int, StationRoute] = {}
        self._count = 0
        self._carriers: dict[Key, frozenset[int]] = {}
        self._sent: dict[Key, None] = {}
        self._came: dict[Key, int] = {}
        self._certain: dict[Key, set[int]] = {}

    def open(self, route: StationRoute) -> int:
        """One more way; its number."""
        self._count += 1
        self._routes[self._count] = route
        return self._count

    def close(self, number: int) -> None:
        """A way is no longer there, and has no say any more."""
        self._routes.pop(number, None)

    def carries(self, number: int, envelope: Envelope[Any]) -> bool:
        """Whether a message of the station goes by this way."""
        if len(self._routes) < 2:
            return True
        key = _key(envelope)
        if key not in self._carriers:
            _remember(self._carriers, key, self._choose(envelope))
        return number in self._carriers[key]

    def is_new(self, number: int, envelope: Envelope[Any]) -> bool:
        """Whether a message that has come by this way has not come by another."""
        if len(self._routes) < 2:
            return True
        return _remember(self._came, _key(envelope), number) == number

    def is_lost(self, number: int, lost: Undelivered) -> bool:
        """Whether a way's word that it could not deliver a message is that of all that carried it.

        It is certainly not delivered only when each of them has said so; that it may have arrived is told at once.
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
    """What is remembered of a message, the value if it is new; what is oldest is forgotten."""
    known = memory.setdefault(key, value)
    if len(memory) > MAX_REMEMBERED:
        del memory[next(iter(memory))]
    return known
