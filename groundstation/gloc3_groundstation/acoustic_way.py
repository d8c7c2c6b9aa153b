"""The station's end of an acoustic modem: hears summaries, and sends an emergency by sound when nothing else leads there."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from gloc3.acoustic.frames import AcousticCode, AcousticSummary, Order, Receipt, Verb
from gloc3.ci import CiRequest, Emergency, EmergencyVerb
from gloc3.clock import Clock
from gloc3.exchange.base import Exchange, Publisher
from gloc3.link.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.link.signing_key import read_signing_key
from gloc3.messages import Envelope, Severity
from gloc3_groundstation.station import Station

AGAIN_S: Final = 12.0
"""An order and its receipt are seconds on their way; then it is said again."""
PATIENCE_S: Final = 120.0
"""An order that has no receipt by then is given up: it is not carried out behind the operator's back."""
_VERBS: Final = {EmergencyVerb.HOLD: Verb.HOLD, EmergencyVerb.LAND: Verb.SURFACE}


class AcousticWay:
    """One modem, for one platform.

    Args:
        platform: its name.
        exchange: the station's.
        loop: wakes it.
        boot: a random number for this start of the station.
        send: puts a frame on the modem.
        is_silent: whether the platform is not heard in any other way.
        told: is told in words what becomes of an order.
        now_utc_s: the time of day; numbers the orders, so that a restarted station's are newer.
        key: of the link; None for none.
    """

    def __init__(
        self,
        platform: str,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        boot: int,
        send: Callable[[bytes], None],
        is_silent: Callable[[], bool],
        told: Callable[[str], None],
        now_utc_s: Callable[[], float],
        key: bytes | None = None,
    ) -> None:
        self.code: Final = AcousticCode(platform, key)
        self._platform, self._loop, self._send = platform, loop, send
        self._is_silent, self._told, self._now_utc_s = is_silent, told, now_utc_s
        self._publisher = Publisher(exchange, platform, "acoustic", boot)
        self._number = 0
        """Of the last order."""
        self._order: tuple[Order, float] | None = None
        """What waits for its receipt, and until when."""
        self._timer: asyncio.TimerHandle | None = None
        self._undo = exchange.subscribe(f"{platform}/ci/request", self._take)

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
                        f"{self._platform} has {'taken' if is_accepted else 'REFUSED'} the order: {verb} (by sound)"
                    )

    def order(self, verb: Verb) -> None:
        """Orders something, in place of what was ordered before."""
        self._number = max(self._number + 1, int(self._now_utc_s())) & 0xFFFF_FFFF
        self._order = Order(self._number, verb), self._loop.time() + PATIENCE_S
        self._told(f"the order goes to {self._platform} by sound: {verb.name.lower()}; wait for its receipt")
        self._say()

    def _take(self, envelope: Envelope[Any]) -> None:
        request = envelope.payload
        if isinstance(request, CiRequest) and isinstance(request.body, Emergency) and self._is_silent():
            verb = _VERBS.get(request.body.verb)
            if verb is not None:
                self.order(verb)

    def _say(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._order is None:
            return
        order, until_s = self._order
        if self._loop.time() >= until_s:
            self._end(f"no receipt came from {self._platform}: it is not known whether it has the order")
            return
        self._send(self.code.encode(order))
        self._timer = self._loop.call_later(AGAIN_S, self._say)

    def _end(self, text: str) -> None:
        self._order = None
        if self._timer is not None:
            self._timer.cancel()
        self._told(text)


class Modem:
    """An acoustic modem of the station, with its endpoint."""

    def __init__(self, way: AcousticWay, endpoint: Endpoint) -> None:
        self.way: Final = way
        self._endpoint = endpoint

    @property
    def local_port(self) -> int | None:
        """Where it listens; None for a serial line."""
        return self._endpoint.local_port

    async def close(self) -> None:
        """Closes both."""
        self.way.close()
        await self._endpoint.close()


async def open_modem(platform: str, url: str, station: Station, exchange: Exchange, boot: int) -> Modem:
    """Opens a modem that leads to a platform.

    Raises:
        Refused: its address cannot be had.
        InputError: the key file that the URL names has no key.
    """
    loop, file = asyncio.get_running_loop(), parse_url(url).key
    key = read_signing_key(Path(file).expanduser()) if file else None
    ways: list[AcousticWay] = []
    endpoint = await open_endpoint(url, loop, lambda data: ways[0].receive(data) if ways else None)

    def is_silent() -> bool:
        known = station.fleet.get(platform)
        return known is None or known.is_quiet_link(loop.time())

    def told(text: str) -> None:
        station.note(platform, Severity.NOTICE, text)

    ways.append(AcousticWay(platform, exchange, loop, boot, endpoint.send, is_silent, told, Clock(loop).utc_s, key))
    return Modem(ways[0], endpoint)
