"""Probes of one number (gas, temperature, salinity…) that send lines of text over a serial line or TCP."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Final

from gloc3.errors import Finding, Gloc3Error, InputError, nearest
from gloc3.messages.envelope import Message
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Probe, StampedReading
from gloc3_onboard.sensors.line import Line, open_line
from gloc3_onboard.sensors.registry import SensorKind, SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records
from gloc3_onboard.sensors.source_url import BAUD as BAUD_OPTION
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, SourceUrl
from gloc3_onboard.sensors.threaded import ThreadedSource

BAUD: Final = 9600
WAIT_S: Final = 0.3
_NONSENSE: Final = 50
"""Lines without a value, before the first with one, after which the device counts as incompatible."""
_MOST_BYTES: Final = 512
"""Of a line; longer ones are dropped."""
_NUMBER: Final = r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


class LineDecoder:
    """Takes the values out of lines such as `co2 612.4 ppm`, `CO2=612.4ppm` or `612.4`.

    Args:
        name: word before the value, in any case; empty for the first number of each line.
    """

    def __init__(self, name: str) -> None:
        before = rf"(?<!\w){re.escape(name)}(?!\w).*?" if name else ""
        self._value_of: Final = re.compile(f"{before}({_NUMBER})", re.IGNORECASE | re.ASCII)
        self._rest = b""
        self.unread = 0
        """Lines without a value."""

    def receive(self, data: bytes) -> list[float]:
        """The finite values in what has come in, in order."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = b"" if len(self._rest) > _MOST_BYTES else self._rest
        matches = [self._value_of.search(line[:_MOST_BYTES].decode("utf-8", "replace")) for line in lines]
        found = [value for match in matches if match is not None and isfinite(value := float(match[1]))]
        self.unread += len(lines) - len(found)
        return found


class LineProbe(ThreadedSource[StampedReading]):
    """A device that sends its value, a line at a time.

    Args:
        name: name of the device.
        url: `lines:///dev/ttyUSB0?baud=9600#co2` or `lines://HOST:PORT#co2`.
        now_s: our time.
    """

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url
        self._address = None if url.place.startswith("/") else url.address(name)

    def reading(self) -> StampedReading | None:
        """The latest reading; None before the first.

        Raises:
            Gloc3Error: the device is lost.
        """
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedReading | None]]:
        """Opens the line."""
        line = open_line(self.name, self._url, self._address, BAUD, WAIT_S)
        try:
            yield self._readings(line)
        finally:
            line.close()

    def _readings(self, line: Line) -> Iterator[StampedReading | None]:
        decoder, has_understood = LineDecoder(self._url.part), False
        while True:
            values = decoder.receive(line.read())
            has_understood = has_understood or bool(values)
            if decoder.unread > _NONSENSE and not has_understood:
                after = f" after {self._url.part!r}" if self._url.part else ""
                raise Gloc3Error(f"{self.name}: {self._url.place} sends lines, but none with a number{after}")
            yield StampedReading(self.now_s(), values[-1]) if values else None


class ReplayProbe(Replay[float]):
    """A probe of a log."""

    _reading: StampedReading | None = None

    def play(self, t_s: float, item: float) -> None:
        """Keeps a value."""
        self._reading = StampedReading(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._reading = None

    def reading(self) -> StampedReading | None:
        """The latest reading; None before the first."""
        self.check()
        return self._reading


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[float]]:
    topic, dot, field = part.rpartition(".")
    if not dot:
        hint = "write #TOPIC.FIELD, such as #co2.value_ppm"
        raise InputError(
            [
                Finding(
                    file=str(log), message=f"{device}: it is not said which number of which topic it reads", hint=hint
                )
            ]
        )
    records = topic_records(log, topic, Message)
    fields = records[0].load().__struct_fields__
    if field not in fields:
        message = f"{device}: {topic} has no field {field!r}"
        raise InputError([Finding(file=str(log), message=message, hint=nearest(field, fields))])
    return [Recorded(record.log_s, partial(_number, record, field)) for record in records]


def _number(record: Recorded[Message], field: str) -> float:
    value: Any = getattr(record.load(), field)
    if not isinstance(value, int | float):
        raise Gloc3Error(f"{field} is not a number: {value!r}")
    return float(value)


def _poll(device: Probe) -> Sequence[Image]:
    device.reading()
    return ()


def _make(request: SourceRequest) -> LineProbe:
    return LineProbe(request.device, request.url, request.now_s)


SENSORS: Final = (SensorKind("probe", ReplayProbe, _recorded, _poll),)
SOURCES: Final = (
    SourceKind(
        "lines",
        ("probe",),
        "lines:///dev/ttyUSB0#co2, or lines://192.168.0.30:4001#co2",
        _make,
        BAUD_OPTION,
        takes_part=True,
        group=SERIAL_GROUP,
    ),
)
