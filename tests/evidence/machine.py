"""Bars on processor time, as ratios to a fixed task: machines differ, and each is slower beside other work."""

from typing import Final

from tests.benchmarks.world import remap_ms

REMAP_MS: Final = 0.68
"""One remap of a picture of 640×480 on the machine for which the bars were set."""


class Cost:
    """Processor time beside that of one remap at the same moment.

    Args:
        cost_ms: what it took, ms.
        remap: what a remap took then, ms; None to measure it now.
    """

    def __init__(self, cost_ms: float, remap: float | None = None) -> None:
        self.cost_ms = cost_ms
        self.remaps = cost_ms / (remap_ms() if remap is None else remap)

    def __str__(self) -> str:
        return f"{self.cost_ms:.2f} ms, {self.remaps:.1f} remaps"

    def is_at_most(self, most_ms: float) -> bool:
        """Whether it is no more than this on the machine for which the bars were set."""
        return self.remaps <= most_ms / REMAP_MS


def at_most(most_ms: float) -> str:
    """A bar in words."""
    return f"≤ {most_ms / REMAP_MS:.1f} remaps ({most_ms:g} ms where one takes {REMAP_MS:g} ms)"
