"""Whether the autopilot may be armed, as the platform's command interface sees it: by its summaries."""

from typing import Final

from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import WELL, Summary

SILENT_S: Final = 3.0


class ArmAuthority:
    """Listens to the summaries; nobody is armed while there are none, or a required component is not well."""

    def __init__(self, exchange: Exchange, platform: str) -> None:
        self._latest: Envelope[Summary] | None = None
        self._unsubscribe = exchange.subscribe(f"{platform}/ci/summary", self._take)

    def close(self) -> None:
        """Listens no more."""
        self._unsubscribe()

    def _take(self, envelope: Envelope[Summary]) -> None:
        self._latest = envelope

    def why_not(self, now_s: float) -> str:
        """Why the vehicle must not be armed now; empty where it may."""
        if self._latest is None or now_s - self._latest.t_s > SILENT_S:
            return "the companion's command interface does not work"
        health = self._latest.payload.health
        return "" if health in WELL else f"a component that the vehicle needs is {health}"
