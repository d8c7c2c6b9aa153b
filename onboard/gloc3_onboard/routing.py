"""The MAVLink router of the onboard process: its links, each with a way in and a way out."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Final, Literal

from gloc3.link.codec import Frame, Parser
from gloc3.link.endpoints import SERIAL_SCHEMES, Endpoint, parse_url
from gloc3.link.outlet import Outlet
from gloc3.link.router import Router

BITS_PER_BYTE: Final = 10.0
"""On a serial line, with start and stop bits."""


Keep = Callable[[str, Literal["in", "out"], bytes], None]
"""Takes a link's URL, a direction, and a frame."""


def _keep_nothing(_url: str, _direction: Literal["in", "out"], _frame: bytes) -> None:
    """For links whose traffic nobody wants."""


class RoutedLink:
    """One link: what it hears goes to a listener and to the other links, what is sent shares its line.

    Args:
        url: where it leads.
        router: the other links.
        loop: the process's loop.
        listener: gets every frame that is heard, and gives those that may be passed on.
        keep: gets each frame that is heard, or is sent as our own, for a log.
    """

    is_datagram = True
    """Whoever sends through it gives whole frames."""

    def __init__(
        self,
        url: str,
        router: Router,
        loop: asyncio.AbstractEventLoop,
        listener: Callable[[list[Frame]], Iterable[Frame]],
        keep: Keep = _keep_nothing,
    ) -> None:
        self._loop, self._router, self._listener = loop, router, listener
        self._url, self._keep = url, keep
        self._parser = Parser()
        self._own = Parser(is_datagram=True)
        self._endpoint: Endpoint | None = None
        self._timer: asyncio.TimerHandle | None = None
        wanted = parse_url(url)
        baud = wanted.baud if wanted.scheme in SERIAL_SCHEMES else None  # a line whose rate is not known paces itself
        rate_byte_s = None if baud is None else baud / BITS_PER_BYTE
        self.outlet: Final = Outlet(self._write, rate_byte_s)
        self.routed: Final = router.attach(url, self._forward)

    def open(self, endpoint: Endpoint) -> None:
        """Begins; the endpoint's owner passes what it hears to `receive`."""
        self._endpoint = endpoint
        self._parser = Parser(is_datagram=endpoint.is_datagram)

    def close(self) -> None:
        """Sends nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        self._endpoint = None

    def receive(self, data: bytes) -> None:
        """Takes in what the endpoint has heard."""
        now_s, route, link = self._loop.time(), self._router.route, self.routed
        frames = self._parser.receive(data)
        for frame in frames:
            self._keep(self._url, "in", frame.raw)
        for frame in self._listener(frames):
            route(link, frame, now_s)

    def send(self, data: bytes) -> None:
        """Sends a frame of our own."""
        self._keep(self._url, "out", data)
        for frame in self._own.receive(data):
            self._forward(frame)

    def _forward(self, frame: Frame) -> None:
        self.outlet.put(frame, self._loop.time())
        if self._timer is None:
            self._wait()

    def _wait(self) -> None:
        next_s = self.outlet.next_s()
        if next_s is not None:
            self._timer = self._loop.call_at(next_s, self._pump)

    def _pump(self) -> None:
        self._timer = None
        self.outlet.pump(self._loop.time())
        self._wait()

    def _write(self, data: bytes) -> None:
        if self._endpoint is not None:
            self._endpoint.send(data)
