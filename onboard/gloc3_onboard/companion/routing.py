"""MAVLink router of the onboard process: its links, each with input and output."""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from typing import Final, Literal

from gloc3.mavlink.codec import Frame, Parser
from gloc3.mavlink.outlet import LinkOutlet
from gloc3.mavlink.router import Router
from gloc3.mavlink.signing import SignedOnly
from gloc3.mavlink.transport.endpoints import SERIAL_SCHEMES, Endpoint, parse_url
from gloc3.mavlink.transport.serial_line import SerialEndpoint
from gloc3.messages.link_traffic import LinkTraffic
from gloc3.messages.readiness import LinkCondition

BITS_PER_BYTE: Final = 10.0
"""On a serial line, with start and stop bits."""
DATAGRAM_BYTES: Final = 1400
"""What every network carries in one piece."""
Keep = Callable[[str, Literal["in", "out"], bytes], None]
"""Takes a link's URL, a direction, and a frame."""


class RoutedLink:
    """One link: what it receives goes to listeners and to the other links, what is sent shares its line.

    Args:
        url: where it leads.
        router: the other links.
        loop: the process's loop.
        listeners: get the frames that are received and may be used, one after the other; none where they are only passed on.
        signed_only: tells which frames may be used and passed on; None where all may.
        keep: gets each frame that is heard, or is sent as our own, for a log; None where nobody wants them.
        withheld: tells which frames go to the listeners alone; None where none does.
    """

    def __init__(
        self,
        url: str,
        router: Router,
        loop: asyncio.AbstractEventLoop,
        listeners: Sequence[Callable[[list[Frame]], object]] = (),
        keep: Keep | None = None,
        signed_only: SignedOnly | None = None,
        withheld: Callable[[Frame], bool] | None = None,
    ) -> None:
        self._withheld = withheld
        self._loop, self._router, self._listeners = loop, router, listeners
        wanted = parse_url(url)
        self.url: Final = wanted.address
        self._keep, self._signed_only = keep, signed_only
        self._parser = Parser()
        self._endpoint: Endpoint | None = None
        self._timer: asyncio.TimerHandle | None = None
        line_bit_s = wanted.line_bit_s
        self._is_paced = line_bit_s is not None or wanted.scheme in SERIAL_SCHEMES
        self.outlet: Final = LinkOutlet(self._write, None if line_bit_s is None else line_bit_s / BITS_PER_BYTE)
        self.routed: Final = router.attach(self.url, self._forward)
        self._last = LinkCondition(self.url, "not open")
        self._polled: tuple[float, int, int] = (loop.time(), 0, 0)

    def open(self, endpoint: Endpoint) -> None:
        """Opens the link; the endpoint's owner passes received data to `receive`."""
        self._endpoint = endpoint
        self._parser = Parser(is_datagram=endpoint.is_datagram)
        self.routed.origin = lambda: endpoint.origin

    def close(self) -> None:
        """Sends nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        self._last = self.condition()
        self._endpoint = None

    def receive(self, data: bytes) -> None:
        """Handles received data: frames are forwarded first."""
        now_s = self._loop.time()
        frames = self._parser.receive(data)
        good = frames if self._signed_only is None else _genuine(frames, self._signed_only, now_s)
        if good:
            passed = good if self._withheld is None else _without(good, self._withheld)
            self._router.route(self.routed, passed, now_s)
        if self._keep is not None:
            for frame in frames:
                self._keep(self.url, "in", frame.raw)
        if good:
            for listener in self._listeners:
                listener(good)

    def send(self, frame: Frame) -> None:
        """Sends a frame of our own."""
        if self._keep is not None:
            self._keep(self.url, "out", frame.raw)
        self._forward((frame,))

    def _forward(self, frames: Sequence[Frame]) -> None:
        """Frames that came together leave a network together: one datagram costs as much as one frame."""
        count = len(frames)
        self.routed.counts.frames_out += count
        if self._is_paced:
            now_s = self._loop.time()
            if self.outlet.rate_byte_s is None:
                self._request_rate()
            for frame in frames:
                self.outlet.put(frame, now_s)
            if self._timer is None:
                self._wait()
        elif self._endpoint is None:
            return
        elif count == 1:
            self._endpoint.send(frames[0].raw)
        else:
            for piece in _pieces(frames):
                self._endpoint.send(piece)

    def _request_rate(self) -> None:
        """Adopts the rate of a line that detects it; nothing is sent there before."""
        endpoint = self._endpoint
        if isinstance(endpoint, SerialEndpoint) and endpoint.is_connected:
            self.outlet.rate_byte_s = endpoint.baud / BITS_PER_BYTE

    def condition(self) -> LinkCondition:
        """State and traffic; rates are those since the last call. May be called from any thread."""
        endpoint = self._endpoint
        if endpoint is None:
            return self._last
        now_s, counts, outlet = self._loop.time(), self.routed.counts, self.outlet
        bytes_in, bytes_out = endpoint.bytes_received, endpoint.bytes_sent
        was_s, was_in, was_out = self._polled
        period_s = max(1e-3, now_s - was_s)
        self._polled = now_s, bytes_in, bytes_out
        dropped = {kind.value: count for kind, count in outlet.dropped.items() if count}
        if endpoint.dropped:
            dropped["link"] = endpoint.dropped
        refused = {} if self._signed_only is None else self._signed_only.refused()
        if counts.refused:
            refused["senders without room, or in our autopilot's name, or keys"] = counts.refused
        traffic = LinkTraffic(
            frames_in=counts.frames_in,
            frames_out=max(0, counts.frames_out - sum(dropped.values()) - outlet.overtaken - outlet.waiting),
            bytes_in=bytes_in,
            bytes_out=bytes_out,
            bytes_in_s=round((bytes_in - was_in) / period_s, 1),
            bytes_out_s=round((bytes_out - was_out) / period_s, 1),
            lost=counts.lost,
            damaged_bytes=self._parser.bytes_dropped,
            waiting=outlet.waiting,
            overtaken=outlet.overtaken,
            dropped=dropped,
            returned=counts.returned,
            unroutable=counts.unroutable,
            refused=refused,
            genuine=0 if self._signed_only is None else self._signed_only.genuine,
        )
        problem = "" if endpoint.is_connected else endpoint.problem or "nothing is received there"
        return LinkCondition(self.url, problem, bytes_in, traffic, endpoint.intruder)

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


def _genuine(frames: list[Frame], gate: SignedOnly, now_s: float) -> list[Frame]:
    """The frames that may be used."""
    return [frame for frame in frames if gate.passes(frame, now_s)]


def _without(frames: list[Frame], withheld: Callable[[Frame], bool]) -> list[Frame]:
    """The frames that may be passed on."""
    return [frame for frame in frames if not withheld(frame)]


def _pieces(frames: Sequence[Frame]) -> Iterator[bytes]:
    """Frames joined into datagrams that a network carries unfragmented."""
    piece = b""
    for frame in frames:
        if piece and len(piece) + len(frame.raw) > DATAGRAM_BYTES:
            yield piece
            piece = b""
        piece += frame.raw
    yield piece
