"""Corrections that wait for one link: a share of its line, whole frames, and nothing that is late."""

from collections import deque
from typing import Final

from gloc3.errors import Refused
from gloc3.exchange.tunnel.pacing import Bucket
from gloc3.mavlink.services.corrections import PIECE_BYTES
from gloc3.mavlink.transport.endpoints import DEFAULT_BAUD, SERIAL_SCHEMES, parse_url
from gloc3.rtcm3 import RtcmFrame, is_observation

SHARE: Final = 0.3
"""Of a line whose rate is known."""
NETWORK_BYTE_S: Final = 10_000.0
"""On a link whose rate is not known."""
MOST_LATE_S: Final = 1.0
"""Observations that wait for longer are left out: the next ones are there."""
BURST_BYTES: Final = 400.0
WIRE_BYTES: Final = 16
"""Around each piece: MAVLink 2 and the fields of GPS_RTCM_DATA."""
MOST_WAITING: Final = 64


def rate_byte_s(url: str) -> float:
    """What corrections may take of a link, bytes a second.

    Args:
        url: of the link; one that is no endpoint's counts as a network.
    """
    try:
        wanted = parse_url(url)
    except Refused:
        return NETWORK_BYTE_S
    if wanted.line_bit_s is None and wanted.scheme not in SERIAL_SCHEMES:
        return NETWORK_BYTE_S
    return (wanted.line_bit_s or DEFAULT_BAUD) / 10.0 * SHARE


class CorrectionQueue:
    """The queue of one link. Rare messages, such as the base's position, go first; observations in their order.

    Args:
        rate: bytes a second that may leave.
    """

    def __init__(self, rate: float) -> None:
        self.left_out = 0
        """Frames that the link has no room for."""
        self._bucket = Bucket(rate, BURST_BYTES)
        self._rare: deque[tuple[float, RtcmFrame]] = deque()
        self._observations: deque[tuple[float, RtcmFrame]] = deque()

    def put(self, frame: RtcmFrame, now_s: float) -> None:
        """Takes a frame."""
        queue = self._observations if is_observation(frame.message_type) else self._rare
        if len(queue) >= MOST_WAITING:
            queue.popleft()
            self.left_out += 1
        queue.append((now_s, frame))

    def ready(self, now_s: float) -> list[RtcmFrame]:
        """The frames that may leave now."""
        while self._observations and now_s - self._observations[0][0] > MOST_LATE_S:
            self._observations.popleft()
            self.left_out += 1
        self._bucket.fill(now_s)
        found = []
        while (queue := self._rare or self._observations) and self._bucket.is_open:
            _, frame = queue.popleft()
            self._bucket.spend(len(frame.raw) + WIRE_BYTES * (1 + len(frame.raw) // PIECE_BYTES))
            found.append(frame)
        return found

    def next_s(self) -> float | None:
        """When a frame may leave; None while none waits."""
        return self._bucket.open_s() if self._rare or self._observations else None
