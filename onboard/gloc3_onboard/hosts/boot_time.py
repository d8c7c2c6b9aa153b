"""When the autopilot began to count its time, for sources whose stamps are in it, in processes without its link."""

from typing import Any

from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.hosts import HOSTS, HostStatus


class BootTime:
    """Knows it from the clock host's status.

    Args:
        exchange: of this process.
        platform: the platform's name.
    """

    def __init__(self, exchange: Exchange, platform: str) -> None:
        self._boot_s: float | None = None
        exchange.subscribe(f"{platform}/{HOSTS}/*", self._receive_status)

    def t_s_of_boot(self, boot_s: float) -> float | None:
        """The platform's time of a moment in the autopilot's own; None while nothing has been heard of it."""
        return None if self._boot_s is None else self._boot_s + boot_s

    def _receive_status(self, envelope: Envelope[Any]) -> None:
        status = envelope.payload
        if isinstance(status, HostStatus) and status.is_clock_host:
            self._boot_s = status.vehicle_boot_s
