"""Pacing of frames: a budget in bytes a second, adapted to the bandwidth of the link.

The rate falls when round trips become longer than the shortest ones (something queues before the link), or when most
frames are lost; it rises again up to the rate that was configured. Loss alone does not lower it: radios lose frames.
"""

from __future__ import annotations

from typing import Final

import msgspec

from gloc3.exchange.tunnel.layout import WIRE_OVERHEAD
from gloc3.mavlink.parser import SIGNATURE_LENGTH
from gloc3.mavlink.transport.endpoints import DEFAULT_BAUD, SERIAL_SCHEMES, parse_url

SLOW_START_BYTE_S: Final = 5760.0
"""No link is tried faster than a 57,600 baud radio before it has answered."""
FLOOR_BYTE_S: Final = 200.0
QUEUE_LONG_S: Final = 0.3
QUEUE_SHORT_S: Final = 0.12
LOSS_HEAVY: Final = 0.5
SAMPLES: Final = 3
"""Round trips that are sampled before the rate is changed."""


class LinkBudget(msgspec.Struct, frozen=True, kw_only=True):
    """What a link carries and how much of it the tunnel may take."""

    rate_bit_s: float = 57_600.0
    """The line's rate, or an upper bound where it is not known."""
    bits_per_byte: float = 10.0
    """10 for a serial line with start and stop bits."""
    share: float = 0.95
    """Of the line, for the tunnel as a whole."""
    status_share: float = 0.5
    """Of the line, for best effort while nothing large is transferred."""
    busy_status_share: float = 0.12
    """The same while a mission is transferred; hellos and tables add 1 to 2 %."""
    view_share: float = 0.35
    """Of the line, for samples for viewers; it uses only what everything else leaves."""
    busy_view_share: float = 0.005
    """The same while a mission is transferred."""
    overhead_bytes: int = WIRE_OVERHEAD
    """Around each payload: MAVLink 2 and TUNNEL's own fields; 30 on a signed link."""

    @property
    def rate_byte_s(self) -> float:
        """The line's rate in bytes a second."""
        return self.rate_bit_s / self.bits_per_byte


RADIO: Final = LinkBudget()
"""A telemetry radio of 57,600 baud."""


class Bucket:
    """Bytes that may be sent: fills at a rate, and may be overdrawn by the frame that empties it."""

    __slots__ = ("_burst_bytes", "_filled_s", "_level_bytes", "rate_byte_s")

    def __init__(self, rate_byte_s: float, burst_bytes: float) -> None:
        self.rate_byte_s = rate_byte_s
        self._burst_bytes = burst_bytes
        self._level_bytes = burst_bytes
        self._filled_s = 0.0

    def fill(self, now_s: float) -> None:
        """Lets time pass."""
        if now_s > self._filled_s:
            level = self._level_bytes + (now_s - self._filled_s) * self.rate_byte_s
            self._level_bytes = min(self._burst_bytes, level)
            self._filled_s = now_s

    @property
    def is_open(self) -> bool:
        """Whether a frame may be sent, as of the last `fill`."""
        return self._level_bytes > -1e-6

    def open_s(self) -> float:
        """When a frame may be sent."""
        return self._filled_s + max(0.0, -self._level_bytes / self.rate_byte_s)

    def spend(self, size_bytes: float) -> None:
        """Takes bytes out."""
        self._level_bytes -= size_bytes


class Pacer:
    """The budget of one link: for everything, and within it for best effort and for viewers."""

    def __init__(self, budget: LinkBudget) -> None:
        self.budget: Final = budget
        self._ceiling_byte_s = budget.rate_byte_s * budget.share
        self.rate_byte_s = min(self._ceiling_byte_s, SLOW_START_BYTE_S)
        """What the link is thought to carry now."""
        frame_bytes = 128.0 + budget.overhead_bytes
        self.line = Bucket(self.rate_byte_s, frame_bytes)
        self.status = Bucket(self.rate_byte_s * budget.status_share, 2.0 * frame_bytes)
        self.views = Bucket(self.rate_byte_s * budget.view_share, 2.0 * frame_bytes)
        self._is_busy = False
        self._changed_s = 0.0
        self._queue_s = float("inf")
        self._samples = 0
        self._set_rate(self.rate_byte_s)

    def set_busy(self, is_busy: bool) -> None:
        """Whether something large is transferred, so that best effort has to keep to its smaller share."""
        if is_busy != self._is_busy:
            self._is_busy = is_busy
            self._set_rate(self.rate_byte_s)

    def fill(self, now_s: float) -> None:
        """Lets time pass."""
        self.line.fill(now_s)
        self.status.fill(now_s)
        self.views.fill(now_s)

    def spend(self, payload_bytes: int, share: Bucket | None = None) -> int:
        """Takes a frame out of the line's budget and, if given, of a share's; returns its bytes on the wire."""
        size_bytes = payload_bytes + self.budget.overhead_bytes
        self.line.spend(size_bytes)
        if share is not None:
            share.spend(size_bytes)
        return size_bytes

    def adapt(self, round_trip_s: float, queue_s: float, loss: float, now_s: float) -> None:
        """Learns from an acknowledged frame, changes the rate at most once a round trip.

        Args:
            round_trip_s: of the frame.
            queue_s: how much longer that was than the shortest of late.
            loss: fraction of data frames lost of late.
            now_s: the time.
        """
        self._queue_s = min(self._queue_s, queue_s)  # what queues delays every frame, jitter only some
        self._samples += 1
        if now_s - self._changed_s < round_trip_s or self._samples < SAMPLES:
            return
        self._changed_s, queue_s, self._queue_s, self._samples = now_s, self._queue_s, float("inf"), 0
        if queue_s > QUEUE_LONG_S or loss > LOSS_HEAVY:
            self._set_rate(self.rate_byte_s * 0.75)
        elif queue_s > QUEUE_SHORT_S:
            self._set_rate(self.rate_byte_s * 0.95)
        else:
            self._set_rate(self.rate_byte_s * 1.5)

    def _set_rate(self, rate_byte_s: float) -> None:
        self.rate_byte_s = min(self._ceiling_byte_s, max(FLOOR_BYTE_S, rate_byte_s))
        self.line.rate_byte_s = self.rate_byte_s
        budget = self.budget
        share = budget.busy_status_share if self._is_busy else budget.status_share
        self.status.rate_byte_s = self.rate_byte_s / budget.share * share
        share = budget.busy_view_share if self._is_busy else budget.view_share
        self.views.rate_byte_s = self.rate_byte_s / budget.share * share


NETWORK_BIT_S: Final = 2_000_000.0
"""Assumed for network links, whose rate is unknown; the pacer slows down where the link carries less."""


def budget_of(url: str, *, is_signed: bool = False) -> LinkBudget:
    """Link budget: from the configured radio rate, a serial line's baud rate (or its default), or the network rate.

    Raises:
        Refused: the URL is wrong.
    """
    wanted = parse_url(url)
    overhead_bytes = WIRE_OVERHEAD + (SIGNATURE_LENGTH if is_signed else 0)
    if wanted.rate_bit_s is not None or wanted.scheme in SERIAL_SCHEMES:
        return LinkBudget(rate_bit_s=float(wanted.line_bit_s or DEFAULT_BAUD), overhead_bytes=overhead_bytes)
    return LinkBudget(rate_bit_s=NETWORK_BIT_S, bits_per_byte=8.0, overhead_bytes=overhead_bytes)
