"""The station's end of an acoustic modem: receives summaries, and sends emergencies if no other link is up."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.clock import Clock
from gloc3.exchange.acoustic import AcousticCode, AcousticOrder, AcousticSummary, AcousticVerb, Receipt
from gloc3.exchange.base import Exchange, Publisher
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3.messages.command_interface import CiRequest, Emergency, EmergencyVerb
from gloc3.messages.envelope import Envelope, Severity
from gloc3_groundstation.station.station import Station

AGAIN_S: Final = 12.0
"""Interval of repeats, s: an order and its receipt take seconds."""
TIMEOUT_S: Final = 120.0
"""Time without a receipt after which an order is given up, s: it must not be executed unexpectedly later."""
_VERBS: Final = {EmergencyVerb.HOLD: AcousticVerb.HOLD, EmergencyVerb.LAND: AcousticVerb.SURFACE}


class ModemContext(msgspec.Struct, frozen=True, kw_only=True):
    """The parts of its station that a modem's route needs."""

    exchange: Exchange
    boot: int
    """A random number for this start of the station."""
    is_silent: Callable[[], bool]
    """Whether the platform is silent on all other routes."""
    report: Callable[[str], None]
    """Receives in words what becomes of an order."""
    now_utc_s: Callable[[], float]
    """The time of day; numbers the orders, so that a restarted station's are newer."""
    key: bytes | None = None
    """Of the link; None for none."""


class AcousticRoute:
    """Route over one modem, for one platform.

    Args:
        platform: its name.
        loop: the event loop, for timers.
        send: sends a frame to the modem.
        context: that of its station.
    """

    def __init__(
        self,
        platform: str,
        loop: asyncio.AbstractEventLoop,
        send: Callable[[bytes], None],
        context: ModemContext,
    ) -> None:
        self.code: Final = AcousticCode(platform, context.key)
        self._platform, self._loop, self._send, self._context = platform, loop, send, context
        self._publisher = Publisher(context.exchange, platform, "acoustic", context.boot)
        self._number = 0
        """Of the last order."""
        self._order: tuple[AcousticOrder, float] | None = None
        """What waits for its receipt, and until when."""
        self._timer: asyncio.TimerHandle | None = None
        self._undo = context.exchange.subscribe(f"{platform}/ci/request", self._handle_request)

    def close(self) -> None:
        """Hears and says nothing more."""
        self._undo()
        if self._timer is not None:
            self._timer.cancel()

    def receive(self, data: bytes) -> None:
        """Takes a frame from the modem."""
        match self.code.decode(data):
            case AcousticSummary() as summary:
                self._publisher.publish(f"{self._platform}/acoustic", summary, self._loop.time())
            case Receipt(number=number, is_accepted=is_accepted):
                if self._order is not None and self._order[0].number == number:
                    verb = self._order[0].verb.name.lower()
                    self._end(
                        f"{self._platform} has {'accepted' if is_accepted else 'REFUSED'} command {verb} (acoustic)"
                    )

    def order(self, verb: AcousticVerb) -> None:
        """Sends an order, replacing the previous one."""
        self._number = max(self._number + 1, int(self._context.now_utc_s())) & 0xFFFF_FFFF
        self._order = AcousticOrder(self._number, verb), self._loop.time() + TIMEOUT_S
        self._context.report(f"sent to {self._platform} by modem: {verb.name.lower()}; wait for its receipt")
        self._transmit()

    def _handle_request(self, envelope: Envelope[Any]) -> None:
        request = envelope.payload
        if isinstance(request, CiRequest) and isinstance(request.body, Emergency) and self._context.is_silent():
            verb = _VERBS.get(request.body.verb)
            if verb is not None:
                self.order(verb)

    def _transmit(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._order is None:
            return
        order, until_s = self._order
        if self._loop.time() >= until_s:
            self._end(f"no receipt from {self._platform}: it may or may not have the command")
            return
        self._send(self.code.encode(order))
        self._timer = self._loop.call_later(AGAIN_S, self._transmit)

    def _end(self, text: str) -> None:
        self._order = None
        if self._timer is not None:
            self._timer.cancel()
        self._context.report(text)


class Modem:
    """An acoustic modem of the station, with its endpoint."""

    def __init__(self, route: AcousticRoute, endpoint: Endpoint) -> None:
        self.route: Final = route
        self._endpoint = endpoint

    @property
    def local_port(self) -> int | None:
        """Where it listens; None for a serial line."""
        return self._endpoint.local_port

    async def close(self) -> None:
        """Closes both."""
        self.route.close()
        await self._endpoint.close()


async def open_modem(platform: str, url: str, station: Station, exchange: Exchange, boot: int) -> Modem:
    """Opens a modem that leads to a platform.

    Raises:
        Refused: its address cannot be had.
        InputError: the key file that the URL names has no key.
    """
    loop, file = asyncio.get_running_loop(), parse_url(url).key
    key = read_signing_key(Path(file).expanduser()) if file else None
    routes: list[AcousticRoute] = []
    endpoint = await open_endpoint(url, loop, lambda data: routes[0].receive(data) if routes else None)
    routes.append(AcousticRoute(platform, loop, endpoint.send, _context(platform, station, exchange, boot, key)))
    if warning := parse_url(url).warning(is_signed=False):
        station.note(platform, Severity.WARNING, warning)
    return Modem(routes[0], endpoint)


def attach_modem(platform: str, end: MemoryEnd, station: Station, exchange: Exchange, boot: int) -> Modem:
    """Opens a modem in memory that leads to a platform."""
    loop = asyncio.get_running_loop()
    route = AcousticRoute(platform, loop, end.send, _context(platform, station, exchange, boot))
    end.on_data = route.receive
    return Modem(route, end)


def _context(platform: str, station: Station, exchange: Exchange, boot: int, key: bytes | None = None) -> ModemContext:
    def is_silent() -> bool:
        known = station.fleet.get(platform)
        return known is None or known.is_quiet_link(station.now_s())

    return ModemContext(
        exchange=exchange,
        boot=boot,
        is_silent=is_silent,
        report=lambda text: station.note(platform, Severity.NOTICE, text),
        now_utc_s=Clock(asyncio.get_running_loop()).utc_s,
        key=key,
    )
