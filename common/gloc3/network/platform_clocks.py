"""Each platform's clock, as a station learns it from the times of its summaries."""

from typing import Any, Final, NamedTuple

from gloc3.messages.envelope import Envelope

CLOCK_DRIFT: Final = 1e-3
"""Two clocks drift apart by less than this share of the time."""


class _ClockSample(NamedTuple):
    boot: int
    ahead_s: float
    """The platform's clock minus ours, less the shortest latency of late."""
    received_s: float


class PlatformClocks:
    """Each platform's clock, learned from the times in its summaries: behind by their latency, never ahead."""

    def __init__(self) -> None:
        self._samples: dict[str, _ClockSample] = {}

    def receive(self, envelope: Envelope[Any], now_s: float) -> None:
        """Handles a summary; with another boot of its source the clock may have started again."""
        platform, boot, ahead_s = envelope.topic.partition("/")[0], envelope.source.boot, envelope.t_s - now_s
        last = self._samples.get(platform)
        if last is not None and last.boot == boot:
            ahead_s = max(ahead_s, last.ahead_s - CLOCK_DRIFT * (now_s - last.received_s))
        self._samples[platform] = _ClockSample(boot, ahead_s, now_s)

    def until_s(self, platform: str, now_s: float, timeout_s: float) -> float:
        """When a time from now on is over by the platform's clock; 0 while that is not known."""
        sample = self._samples.get(platform)
        return 0.0 if sample is None else max(now_s + sample.ahead_s + timeout_s, 0.0)

    def boot(self, platform: str) -> int:
        """The boot of a platform's command interface server; 0 while it is not known."""
        sample = self._samples.get(platform)
        return 0 if sample is None else sample.boot
