"""Message intervals: schedules streams on the vehicle; requests and maintains streams on other components."""

from __future__ import annotations

import math
from collections.abc import Mapping
from heapq import heapify, heappop, heappush
from typing import Final, Never

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest

GET_MESSAGE_INTERVAL: Final = 510
SET_MESSAGE_INTERVAL: Final = 511
REQUEST_MESSAGE: Final = 512
STREAM_COMMANDS: Final = frozenset({GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE})
FASTEST_HZ: Final = 250.0
SILENT_S: Final = 3.0
"""Silence (or five periods, if longer) after which a requested stream is requested again, s."""
_NO_ERROR_S: Final = 1e-6
"""Times that differ by less are the same: sums of periods are not exact."""


LONGEST_US: Final = 2e9
"""Longest interval that MESSAGE_INTERVAL can hold, rounded down."""


class StreamScheduler(Microservice[Never]):
    """The vehicle's side: determines which messages are due, and handles requests for other rates.

    Its owner calls `due` after each tick, and sends those messages.

    Args:
        own: address of this end.
        rates_hz: every message that can be sent, by name, with its usual rate; 0 for one that is sent on request only.
    """

    handles = frozenset({"REQUEST_DATA_STREAM"})

    def __init__(self, own: Address, rates_hz: Mapping[str, float]) -> None:
        super().__init__(own)
        self._usual_hz = {codec.shape(name).id: rate for name, rate in rates_hz.items()}
        self._period_s: dict[int, float] = {}
        self._due: list[tuple[float, int]] = []
        self._once: list[int] = []
        for number, rate_hz in self._usual_hz.items():
            self._set_period(number, 1.0 / rate_hz if rate_hz > 0.0 else None, 0.0)

    def offer(self, name: str, rate_hz: float, now_s: float) -> None:
        """Adds a message that can be sent from now on, with its usual rate."""
        number = codec.shape(name).id
        self._usual_hz[number] = rate_hz
        self._set_period(number, 1.0 / rate_hz if rate_hz > 0.0 else None, now_s)

    def due(self, now_s: float) -> list[int]:
        """Ids of the messages to send now, single requests first."""
        found, self._once = self._once, []
        heap, limit_s = self._due, now_s + _NO_ERROR_S
        while heap and heap[0][0] <= limit_s:
            when_s, number = heappop(heap)
            found.append(number)
            period_s = self._period_s[number]
            heappush(heap, (max(when_s + period_s, now_s + period_s / 2), number))
        return found

    def next_tick_s(self) -> float | None:
        """Next time at which a message is due."""
        if self._once:
            return 0.0
        return self._due[0][0] if self._due else None

    def rate_hz(self, name: str) -> float:
        """How often a message is sent now; 0 for never."""
        period_s = self._period_s.get(codec.shape(name).id)
        return 0.0 if period_s is None else 1.0 / period_s

    def set_rate(self, name: str, rate_hz: float, now_s: float) -> None:
        """Sets how often a message is sent; 0 stops it."""
        self._set_period(codec.shape(name).id, 1.0 / rate_hz if rate_hz > 0.0 else None, now_s)

    def command(self, request: MavCommandRequest, now_s: float) -> CommandResult | None:
        """Runs a command if it is one about streams, and says its result; None for any other."""
        if request.command not in STREAM_COMMANDS:
            return None
        wanted, value = request.params[0], request.params[1]
        if not math.isfinite(wanted) or wanted != int(wanted):
            return CommandResult.DENIED
        number = int(wanted)
        if request.command == GET_MESSAGE_INTERVAL:
            period_s = self._period_s.get(number)
            interval_us = 0 if number not in self._usual_hz else -1 if period_s is None else round(period_s * 1e6)
            self._send("MESSAGE_INTERVAL", message_id=number & 0xFFFF, interval_us=interval_us)
            return CommandResult.ACCEPTED
        if number not in self._usual_hz:
            return CommandResult.DENIED if codec.name_of(number) else CommandResult.UNSUPPORTED
        if request.command == REQUEST_MESSAGE:
            if number not in self._once:
                self._once.append(number)
            return CommandResult.ACCEPTED
        if not -1.0 <= value <= LONGEST_US:
            return CommandResult.DENIED
        if value == 0.0:
            usual_hz = self._usual_hz[number]
            self._set_period(number, 1.0 / usual_hz if usual_hz > 0.0 else None, now_s)
        else:
            self._set_period(number, max(value * 1e-6, 1.0 / FASTEST_HZ) if value > 0.0 else None, now_s)
        return CommandResult.ACCEPTED

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles the deprecated request for all streams at once; groups of streams are not distinguished."""
        if self._is_for_us(message) and message.req_stream_id == 0:
            for number, usual_hz in self._usual_hz.items():
                if usual_hz > 0.0:
                    rate_hz = min(float(message.req_message_rate), FASTEST_HZ) if message.start_stop else 0.0
                    self._set_period(number, 1.0 / rate_hz if rate_hz > 0.0 else None, now_s)

    def _set_period(self, number: int, period_s: float | None, now_s: float) -> None:
        if number in self._period_s:
            self._due = [entry for entry in self._due if entry[1] != number]
            heapify(self._due)
            del self._period_s[number]
        if period_s is not None:
            self._period_s[number] = period_s
            heappush(self._due, (now_s, number))
