"""Unrequested reports to other ground stations: status texts, and the state of the onboard computer.

Our own stations get both as events and topics. MAVLink, common: STATUSTEXT, ONBOARD_COMPUTER_STATUS.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from gloc3.exchange.base import Exchange
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Address, MavlinkMessage
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.messages.envelope import Envelope, Event, Severity
from gloc3_onboard.process.vitals import UNKNOWN, Vitals

PERIOD_S: Final = 5.0
MOST_TEXTS: Final = 10
"""Greatest number of texts in a period; the rest is counted and reported at its end."""
_CORES, _HISTORY = 8, 10


def computer_status(vitals: Vitals, utc_s: float) -> MavlinkMessage:
    """ONBOARD_COMPUTER_STATUS; unknown fields have the protocol's placeholder."""
    unknown_32 = 0xFFFFFFFF
    cpu = UNKNOWN if vitals.cpu_percent is None else vitals.cpu_percent
    return codec.message(
        "ONBOARD_COMPUTER_STATUS",
        time_usec=round(utc_s * 1e6),
        uptime=round(vitals.uptime_s * 1e3) & unknown_32,
        cpu_cores=bytes([UNKNOWN] * _CORES),
        cpu_combined=bytes([cpu] + [UNKNOWN] * (_HISTORY - 1)),
        gpu_cores=bytes([UNKNOWN] * 4),
        gpu_combined=bytes([UNKNOWN] * _HISTORY),
        temperature_board=127,
        temperature_core=(127,) * 8,
        fan_speed=(0x7FFF,) * 4,
        ram_usage=vitals.memory_used_mib or unknown_32,
        ram_total=vitals.memory_total_mib or unknown_32,
        storage_type=(0,) + (unknown_32,) * 3,
        storage_usage=(vitals.disk_used_mib, *(unknown_32,) * 3),
        storage_total=(vitals.disk_total_mib, *(unknown_32,) * 3),
        link_type=(unknown_32,) * 6,
        link_tx_rate=(unknown_32,) * 6,
        link_rx_rate=(unknown_32,) * 6,
        link_tx_max=(unknown_32,) * 6,
        link_rx_max=(unknown_32,) * 6,
    )


class AutopilotReporter:
    """Sends status texts on every link to stations.

    Args:
        exchange: source of the components' events.
        platform: the platform's name.
        own: MAVLink address of the sender.
        loop: the event loop.
        send: sends a message to all stations.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: str,
        own: Address,
        loop: asyncio.AbstractEventLoop,
        send: Callable[[MavlinkMessage], None],
    ) -> None:
        self._texts = StatusTextSender(own)
        self.least_severity = Severity.WARNING
        """Least severity of reported events."""
        self._loop, self._send = loop, send
        self._reported = self._unreported = 0
        self._unsubscribe = exchange.subscribe(f"{platform}/components/*/event", self._receive_event)
        self._timer = loop.call_later(PERIOD_S, self._tick)

    def close(self) -> None:
        """Stops sending."""
        self._unsubscribe()
        self._timer.cancel()

    def _receive_event(self, envelope: Envelope[Event]) -> None:
        event = envelope.payload
        if event.severity > self.least_severity:
            return
        if self._reported >= MOST_TEXTS:
            self._unreported += 1
            return
        self._reported += 1
        self._send_text(event.severity, f"{envelope.source.component}: {event.text}")

    def _send_text(self, severity: Severity, text: str) -> None:
        self._texts.send(severity, text)
        for message in self._texts.outgoing():
            self._send(message)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(PERIOD_S, self._tick)
        if self._unreported:
            self._send_text(Severity.WARNING, f"and {self._unreported} more")
        self._reported = self._unreported = 0
