"""Message rates of a vehicle: measured on the link, and requests for other rates."""

from collections import deque
from typing import Final

import msgspec

from gloc3.errors import Misuse, Refused
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.interval import FASTEST_HZ, SET_MESSAGE_INTERVAL
from gloc3_groundstation.services.machines import Machines

WINDOW_S: Final = 5.0
"""Averaging time of rates."""
MOST_MESSAGES: Final = 512
_MOST_TIMES: Final = 1024


class RateRow(msgspec.Struct, frozen=True, kw_only=True):
    """One message of one component, as it comes now."""

    name: str
    """As in the dialect, or `message 12345`."""
    message_id: int
    source: Address
    rate_hz: float
    """Mean of the last seconds; 0 when it does not come any more."""
    bytes_s: float
    """Bandwidth on the link."""
    age_s: float
    """Since the last one."""
    count: int
    """How many have come."""
    wanted_hz: float | None = None
    """Requested rate; None for none, 0 for off."""


class RateTable(msgspec.Struct, frozen=True, kw_only=True):
    """All messages of a vehicle at one moment, in the order of their names."""

    rows: tuple[RateRow, ...] = ()

    @property
    def total_bytes_s(self) -> float:
        """Bandwidth of all messages on the link."""
        return sum(row.bytes_s for row in self.rows)

    @property
    def total_hz(self) -> float:
        """How many messages come in a second."""
        return sum(row.rate_hz for row in self.rows)

    def find(self, text: str) -> tuple[RateRow, ...]:
        """Rows whose name contains a text, ignoring case."""
        return tuple(row for row in self.rows if text.lower() in row.name.lower())


class _Meter:
    """The times at which one message came."""

    __slots__ = ("count", "size", "times_s")

    def __init__(self) -> None:
        self.times_s: deque[float] = deque(maxlen=_MOST_TIMES)
        self.count = 0
        self.size = 0


class FrameRateMeter:
    """Counts frames."""

    def __init__(self) -> None:
        self.wanted_hz: dict[int, float] = {}
        """Requested rates, by message id."""
        self._meters: dict[tuple[Address, int], _Meter] = {}

    def count(self, frame: Frame, now_s: float) -> None:
        """Takes in a frame of the vehicle."""
        key = (frame.sender, frame.message_id)
        meter = self._meters.get(key)
        if meter is None:
            if len(self._meters) >= MOST_MESSAGES:
                return
            meter = self._meters[key] = _Meter()
        meter.times_s.append(now_s)
        meter.count += 1
        meter.size = len(frame.raw)

    def table(self, now_s: float) -> RateTable:
        """The rates now."""
        rows = []
        for (source, number), meter in self._meters.items():
            times_s = meter.times_s
            last_s = times_s[-1]
            while len(times_s) > 1 and times_s[0] < now_s - WINDOW_S:
                times_s.popleft()
            rate_hz = 0.0
            if last_s >= now_s - WINDOW_S and len(times_s) > 1:
                first_s = times_s[0]
                usual_s = (last_s - first_s) / (len(times_s) - 1)
                # a message that stays away longer than usual comes less often already
                rate_hz = (len(times_s) - 1) / max(last_s - first_s, now_s - first_s - usual_s, 1e-3)
            rows.append(
                RateRow(
                    name=codec.name_of(number) or f"message {number}",
                    message_id=number,
                    source=source,
                    rate_hz=rate_hz,
                    bytes_s=rate_hz * meter.size,
                    age_s=now_s - last_s,
                    count=meter.count,
                    wanted_hz=self.wanted_hz.get(number),
                )
            )
        return RateTable(rows=tuple(sorted(rows, key=lambda row: (row.name, row.source))))


class RateService:
    """Measures message rates and requests others."""

    def __init__(self, machines: Machines, commands: MavCommandClient, meter: FrameRateMeter, target: Address) -> None:
        self._machines = machines
        self._commands = commands
        self._meter = meter
        self._target = target

    @property
    def table(self) -> RateTable:
        """What comes now; measured since the services of the vehicle were opened."""
        return self._meter.table(self._machines.now_s)

    async def request(self, name: str, rate_hz: float | None) -> None:
        """Requests a rate of a message from the vehicle; the table shows whether it complies.

        Args:
            name: name in the dialect, such as `ATTITUDE`; or its number.
            rate_hz: the rate; 0 for off, None for the vehicle's default.

        Raises:
            Refused: there is no such message, or the vehicle does not send it at that rate.
        """
        number = _number_of(name)
        if rate_hz is not None and not 0.0 <= rate_hz <= FASTEST_HZ:
            raise Refused(f"a rate is from 0 to {FASTEST_HZ:g} Hz")
        interval_us = 0.0 if rate_hz is None else -1.0 if rate_hz == 0.0 else 1e6 / rate_hz
        call = self._commands.send_long(
            self._target, SET_MESSAGE_INTERVAL, (number, interval_us), now_s=self._machines.now_s
        )
        try:
            await self._machines.until(lambda: call.result is not None)
        finally:
            self._commands.abandon(call)
        if call.result is not CommandResult.ACCEPTED:
            words = call.result.words if call.result is not None else "cancelled"
            raise Refused(f"{codec.name_of(number) or number}: {words}")
        if rate_hz is None:
            self._meter.wanted_hz.pop(number, None)
        else:
            self._meter.wanted_hz[number] = rate_hz


def _number_of(name: str) -> int:
    text = name.strip().upper()
    if text.isascii() and text.isdigit() and int(text) < 1 << 24:
        return int(text)
    try:
        return codec.shape(text).id
    except Misuse as error:
        raise Refused(str(error)) from None
