"""One peer as this end knows it: who it is, the life that it is in, and the machines that serve it."""

from __future__ import annotations

from collections import deque
from typing import Final

from gloc3.exchange.tunnel.frames import Ask, Echo, Hello
from gloc3.exchange.tunnel.happenings import Counters
from gloc3.exchange.tunnel.path import PeerClock, RoundTrips
from gloc3.exchange.tunnel.receiving import ReliableReceiver
from gloc3.exchange.tunnel.sending import ReliableSender
from gloc3.exchange.tunnel.status import StatusReceiver
from gloc3.exchange.tunnel.table import Channel, PeerTable
from gloc3.mavlink.message import Address

SILENT_AFTER_S: Final = 8.0
ASK_SPACING_S: Final = 0.4
ASK_LIMIT: Final = 40
LIVES_REMEMBERED: Final = 8


class Peer:
    """The other end of the link, or one of several."""

    def __init__(
        self, address: Address, hello: Hello, boot: int, first_number: int, counters: Counters, now_s: float
    ) -> None:
        self._counters = counters
        self.address: Final = address
        self.role: Final = hello.role
        self.name = hello.name
        self.is_alive = True
        self.heard_s = now_s
        self.former_boots: deque[int] = deque(maxlen=LIVES_REMEMBERED)
        self.since_s = now_s
        """When this life was first heard."""
        self._begin(boot, first_number)

    def _begin(self, boot: int, first_number: int) -> None:
        self.boot = boot
        self.clock = PeerClock()
        self.round_trips = RoundTrips()
        self.table = PeerTable()
        self.sender = ReliableSender(boot, first_number, self.round_trips, self._counters)
        self.receiver = ReliableReceiver(self._counters)
        self.status = StatusReceiver(self._counters)
        self.wanted: list[int] = []
        """Rows of our table that it has asked for."""
        self.known: set[int] = set()
        """Channels of ours on which it has acknowledged something."""
        self.tokens: tuple[str, ...] = ()
        self._token_numbers: tuple[int, ...] = ()
        self._hello: tuple[int, float] | None = None
        self._asked_s = -ASK_SPACING_S

    def restart(self, boot: int, first_number: int, now_s: float) -> None:
        """Forgets everything about the process that was there."""
        self.former_boots.append(self.boot)
        self.since_s = now_s
        self._begin(boot, first_number)

    def greet(self, hello: Hello, own: Address, now_s: float) -> float | None:
        """Takes a greeting in; the round trip if it tells one."""
        self._hello = (hello.sent_ms & 0xFFFFFFFF, now_s)
        self._token_numbers = hello.tokens
        self.name = hello.name
        self.table.announce(hello.table_size)
        for echo in hello.echoes:
            if (echo.system, echo.component) == own:
                now_ms = round(now_s * 1000.0)
                asked_s = now_s - ((now_ms - echo.sent_ms) & 0xFFFFFFFF) / 1000.0
                return self.clock.sample(asked_s, hello.sent_ms / 1000.0, echo.held_ms / 1000.0, now_s)
        return None

    def echo(self, now_s: float) -> Echo | None:
        """What our greeting tells this peer, so that it can compare the clocks."""
        if self._hello is None or now_s - self._hello[1] > 60.0:
            return None
        return Echo(*self.address, self._hello[0], round((now_s - self._hello[1]) * 1000.0))

    def live_tokens(self) -> tuple[str, ...]:
        """What it says is alive, as far as its table is here."""
        if not self.is_alive:
            return ()
        channels = (self.table.find(number) for number in self._token_numbers)
        return tuple(channel.topic for channel in channels if channel is not None and channel.source is None)

    def channel(self, number: int) -> Channel | None:
        """What a number of its table stands for; None where it has to be asked."""
        return self.table.find(number)

    def ask_s(self) -> float | None:
        """When it is to be asked for rows of its table; None while nothing is missing."""
        if not self.is_alive or not self.table.missing(1):
            return None
        return self._asked_s + max(ASK_SPACING_S, 0.6 * self.round_trips.smoothed_s)

    def ask(self, now_s: float) -> Ask:
        """The question for the rows that are missing."""
        self._asked_s = now_s
        return Ask(self.table.missing(ASK_LIMIT))

    @property
    def silent_s(self) -> float:
        """When it counts as gone if nothing comes."""
        return self.heard_s + SILENT_AFTER_S
