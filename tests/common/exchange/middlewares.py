"""Two ends of each middleware of the data exchanger, for what holds for all of them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import RADIO_CONDITIONS, pair_on, standard_topics

from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.exchange.zenoh import open_exchange
from gloc3.exchange.zenoh_session import UNIX, ZenohEndpoints
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import CiEvent

PLATFORM = "minoas"
EVENT = f"{PLATFORM}/ci/event"
TABLE = f"{PLATFORM}/ci/table"
TIMEOUT_S = 20.0
QUICK = replace(RADIO_CONDITIONS, latency_s=0.001, loss=0.0, bandwidth_bit_s=10e6, queue_bytes=1_000_000)


class Ends:
    """A platform's end, and one that looks at it."""

    def __init__(self, platform: Exchange, station: Exchange) -> None:
        self.platform = platform
        self.station = station
        self._publisher = Publisher(platform, PLATFORM, "ci", 7)

    def report(self, text: str, topic: str = EVENT, t_s: float = 0.25) -> None:
        """The platform publishes an event."""
        self._publisher.publish(topic, event(text), t_s, "hold")

    async def reach(self, *received: list[str], topic: str = EVENT) -> None:
        """Waits until what the platform says reaches those who listen, then has them forget it."""
        while not all(received):
            self.report("?", topic)
            await asyncio.sleep(0.01)
        self.report("!", topic)
        await until(lambda: all(texts[-1] == "!" for texts in received))
        for texts in received:
            texts.clear()


def receive(exchange: Exchange, pattern: str) -> tuple[list[str], Unsubscribe]:
    """The texts that come on a pattern of topics, and what ends that."""
    texts: list[str] = []

    def handle(envelope: Envelope[CiEvent]) -> None:
        texts.append(envelope.payload.text)

    return texts, exchange.subscribe(pattern, handle)


@asynccontextmanager
async def local(folder: Path) -> AsyncIterator[Ends]:
    """One process."""
    exchange = LocalExchange(standard_topics())
    yield Ends(exchange, exchange)


@asynccontextmanager
async def mavlink(folder: Path) -> AsyncIterator[Ends]:
    """A MAVLink link."""
    station, platform, _ = pair_on(1, QUICK)
    yield Ends(platform.exchange, station.exchange)
    station.close()
    platform.close()


@asynccontextmanager
async def zenoh(folder: Path) -> AsyncIterator[Ends]:
    """Two nodes that meet at a third."""
    loop, topics = asyncio.get_running_loop(), standard_topics()
    place = (f"{UNIX}/{folder}/z",)
    with (
        open_exchange(ZenohEndpoints(name="main", listen=place, peers=("one", "other")), loop, topics),
        open_exchange(ZenohEndpoints(name="one", connect=place), loop, topics) as one,
        open_exchange(ZenohEndpoints(name="other", connect=place), loop, topics) as other,
    ):
        yield Ends(one, other)


ALL = {"local": local, "mavlink": mavlink, "zenoh": zenoh}


async def until(is_so: Callable[[], object], within_s: float = TIMEOUT_S) -> None:
    """Waits for something, in wall time."""
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.01)


def event(text: str) -> CiEvent:
    """An event, which every middleware carries from a platform to its stations."""
    return CiEvent(severity=Severity.INFO, source="x", text=text, t_s=0.25)
