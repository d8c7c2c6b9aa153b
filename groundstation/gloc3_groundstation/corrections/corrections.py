"""RTK corrections of a station: one source, sent to the links of all PX4 and ArduPilot vehicles as GPS_RTCM_DATA."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from msgspec.structs import replace

from gloc3.errors import Refused
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.services.corrections import MOST_BYTES, correction_messages
from gloc3.mavlink.transport.endpoints import open_endpoint
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3.rtcm3 import RtcmFrame, RtcmParser, is_observation
from gloc3_groundstation.corrections.correction_queue import CorrectionQueue, rate_byte_s
from gloc3_groundstation.corrections.source import NetworkSource
from gloc3_groundstation.corrections.source_url import SourceUrl, parse_source
from gloc3_groundstation.station.snapshots import CorrectionsSnapshot, Fleet
from gloc3_groundstation.station.station import Station

PERIOD_S: Final = 1.0
RATE_OVER_S: Final = 5.0
TYPES_KEPT_S: Final = 30.0
"""How long a message type counts as one of the source's."""
MOST_TYPES: Final = 64


class CorrectionsLink(Protocol):
    """The part of a link that corrections need."""

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message of the station's."""


class OpenSource(Protocol):
    """A source that is open: a caster, a server or a serial line."""

    @property
    def problem(self) -> str:
        """Why nothing comes; empty otherwise."""

    async def close(self) -> None:
        """Ends it."""


class Corrections:
    """Takes corrections from one source at a time; without one it does nothing.

    Args:
        station: owner of the fleet, which shows the state of the corrections.
        links: returns URL and link of all vehicles, each vehicle by the link on which it is best received.
    """

    def __init__(self, station: Station, links: Callable[[], Sequence[tuple[str, CorrectionsLink]]]) -> None:
        self._station, self._links = station, links
        self._loop = asyncio.get_running_loop()
        self._source: OpenSource | None = None
        self._poll_timer: asyncio.TimerHandle | None = None
        self._pump_timer: asyncio.TimerHandle | None = None
        self._begin("")

    def _begin(self, shown: str) -> None:
        self._parser = RtcmParser()
        self._queues: dict[CorrectionsLink, CorrectionQueue] = {}
        self._state = CorrectionsSnapshot(source=shown)
        self._received: deque[tuple[float, int]] = deque()
        self._types: dict[int, float] = {}
        self._sequence = 0
        self._left_out = 0
        self._is_awaited = True
        """No corrections have come since the source was opened or failed."""

    async def open(self, url: str) -> None:
        """Takes corrections from a source; it takes the place of the one before.

        Raises:
            Refused: the address is wrong.
        """
        source = parse_source(url)
        await self.stop()
        self._begin(source.shown)
        self._source = await self._opened(source)
        self._poll()

    async def _opened(self, source: SourceUrl) -> OpenSource:
        if source.scheme == "serial":
            return await open_endpoint(source.shown, self._loop, self._receive)
        return NetworkSource(source, self._receive, self._position)

    async def stop(self) -> None:
        """Takes no corrections any more."""
        for timer in (self._poll_timer, self._pump_timer):
            if timer is not None:
                timer.cancel()
        source, self._source = self._source, None
        if source is not None:
            await source.close()
            self._station.change(lambda fleet, _: replace(fleet, corrections=None))

    def _position(self) -> GeoPoint | None:
        """Of the first vehicle whose position is known."""
        now_s = self._station.now_s()
        for platform in self._station.fleet:
            timed = platform.vehicle
            if timed is not None and timed.value.geo is not None and not timed.is_stale(now_s):
                return GeoPoint(*timed.value.geo)
        return None

    # --- corrections ---

    def _receive(self, data: bytes) -> None:
        now_s = self._station.now_s()
        for frame in self._parser.receive(data):
            if frame.message_type:
                self._handle(frame, now_s)
        self._pump()

    def _handle(self, frame: RtcmFrame, now_s: float) -> None:
        self._received.append((now_s, len(frame.raw)))
        if frame.message_type in self._types or len(self._types) < MOST_TYPES:
            self._types[frame.message_type] = now_s
        base_m = frame.base_ecef_m()
        if base_m is not None:
            self._state = replace(self._state, base_ecef_m=base_m)
        if is_observation(frame.message_type):
            self._state = replace(self._state, received_s=now_s)
            if self._is_awaited:
                self._is_awaited = False
                self._station.note("", Severity.NOTICE, f"RTK corrections come from {self._state.source}")
        if len(frame.raw) > MOST_BYTES:
            self._state = replace(self._state, oversized=self._state.oversized + 1)
            return
        for url, link in self._links():
            if link not in self._queues:
                self._queues[link] = CorrectionQueue(rate_byte_s(url))
            self._queues[link].put(frame, now_s)

    def _pump(self) -> None:
        """Sends what may leave, and comes back for the rest."""
        now_s = self._station.now_s()
        for link, queue in self._queues.items():
            for frame in queue.ready(now_s):
                self._sequence += 1
                for message in correction_messages(frame.raw, self._sequence):
                    link.send(message)
        if self._pump_timer is not None:
            self._pump_timer.cancel()
        due = [at_s for queue in self._queues.values() if (at_s := queue.next_s()) is not None]
        self._pump_timer = self._loop.call_at(max(min(due), now_s + 1e-3), self._pump) if due else None

    # --- state ---

    def _poll(self) -> None:
        """Shows the state once a second."""
        source, now_s = self._source, self._station.now_s()
        if source is None:
            return
        self._poll_timer = self._loop.call_at(now_s + PERIOD_S, self._poll)
        present = {link for _, link in self._links()}
        for link in set(self._queues) - present:
            self._left_out += self._queues.pop(link).left_out
        while self._received and now_s - self._received[0][0] > RATE_OVER_S:
            self._received.popleft()
        self._types = {each: at_s for each, at_s in self._types.items() if now_s - at_s <= TYPES_KEPT_S}
        before = self._state.problem
        self._state = replace(
            self._state,
            problem=source.problem,
            rate_byte_s=sum(size for _, size in self._received) / RATE_OVER_S,
            types=tuple(sorted(self._types)),
            links=len(present),
            damaged=self._parser.damaged,
            left_out=self._left_out + sum(queue.left_out for queue in self._queues.values()),
        )
        if source.problem and source.problem != before:
            self._is_awaited = True
            self._station.note("", Severity.WARNING, f"RTK corrections: {source.problem}")
        self._station.change(self._shown)

    def _shown(self, fleet: Fleet, now_s: float) -> Fleet:
        del now_s
        return fleet if fleet.corrections == self._state else replace(fleet, corrections=self._state)


class CorrectionsSwitch(Protocol):
    """What an operator can do with corrections; `Corrections` is one."""

    async def open(self, url: str) -> None:
        """Takes them from a source; raises `Refused` where its address is wrong."""

    async def stop(self) -> None:
        """Takes none any more."""


class NoCorrections:
    """A station without links, as in tests."""

    async def open(self, url: str) -> None:
        """Refuses."""
        del url
        raise Refused("this station takes no corrections")

    async def stop(self) -> None:
        """Does nothing."""
