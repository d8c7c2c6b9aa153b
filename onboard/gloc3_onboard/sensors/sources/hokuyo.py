"""Hokuyo's range scanners, over a serial line or TCP."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

import numpy as np

from gloc3.errors import Gloc3Error
from gloc3.messages.perception import LaserScan
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.devices import StampedScan
from gloc3_onboard.sensors.line import Line, open_line
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import BAUD as BAUD_OPTION
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, SourceUrl
from gloc3_onboard.sensors.sources.laser import MOUNT, mounted_scan
from gloc3_onboard.sensors.sources.scip import (
    IDENTIFY,
    LASER_ON,
    STAMP_MS,
    STOP,
    ScannerParameters,
    ScipError,
    ScipReader,
    measure,
    parameters_of,
    turn_of,
)
from gloc3_onboard.sensors.threaded import ThreadedSource

BAUD: Final = 115_200
"""Of serial lines; those by USB take any."""
WAIT_S: Final = 0.5
ANSWER_S: Final = 3.0
"""Time for its answer, in however many pieces, s."""


class HokuyoLaser(ThreadedSource[StampedScan]):
    """A SCIP 2 scanner: URG, UTM, UST, UBG.

    Args:
        name: name of the device.
        url: `hokuyo:///dev/ttyACM0` or `hokuyo://192.168.0.10:10940`.
        now_s: our time.
    """

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url
        self._address = None if url.place.startswith("/") else url.address(name)

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first."""
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedScan | None]]:
        """Opens the line and has the scanner measure."""
        line = self._line()
        try:
            reader = ScipReader()
            parameters = self._identify(line, reader)
            line.write(LASER_ON)
            line.write(measure(parameters))
            yield self._turns(line, reader, parameters)
        finally:
            with suppress(OSError):
                line.write(STOP)
            line.close()

    def _line(self) -> Line:
        return open_line(self.name, self._url, self._address, BAUD, WAIT_S)

    def _identify(self, line: Line, reader: ScipReader) -> ScannerParameters:
        """Stops any activity of the scanner and reads its identity."""
        line.write(STOP)
        line.write(IDENTIFY)
        until_s = self.now_s() + ANSWER_S
        while self.now_s() < until_s:
            for reply in reader.receive(line.read()):
                if reply[0] == b"PP" and len(reply) > 2:
                    return parameters_of(reply)
        raise Gloc3Error(f"{self.name}: {self._url.place} does not answer as a Hokuyo scanner does (SCIP 2)")

    def _turns(self, line: Line, reader: ScipReader, parameters: ScannerParameters) -> Iterator[StampedScan | None]:
        clock, lap_ms, before_ms = BootClock(), 0, 0
        while True:
            replies = reader.receive(line.read())
            if not replies:
                yield None
            for reply in replies:
                if not reply[0].startswith(b"MD") or len(reply) < 4:
                    continue  # the echo of a command
                with suppress(ScipError):  # a damaged turn is left out; the next one comes soon
                    turn = turn_of(reply, parameters.last - parameters.first + 1)
                    if turn.stamp_ms < before_ms - STAMP_MS // 2:
                        lap_ms += STAMP_MS
                    before_ms = turn.stamp_ms
                    t_s = clock.t_s(float(lap_ms + turn.stamp_ms), self.now_s())
                    yield mounted_scan(t_s, scan_of(self.name, turn.ranges_mm, parameters), self._url)


def scan_of(name: str, ranges_mm: object, parameters: ScannerParameters) -> LaserScan:
    """A turn as a scan; values below the scanner's minimum are error codes, not readings."""
    step_rad = math.tau / parameters.steps_a_turn
    ranges_m = np.asarray(ranges_mm, np.float32) * np.float32(1e-3)
    near_m, far_m = parameters.min_mm / 1000.0, parameters.max_mm / 1000.0
    ranges_m[ranges_m < near_m] = 0.0
    beams = parameters.last - parameters.first
    return LaserScan(
        scanner=name,
        angle_min_rad=(parameters.first - parameters.front) * step_rad,
        angle_step_rad=step_rad,
        range_min_m=near_m,
        range_max_m=far_m,
        ranges_m=ranges_m.astype("<f4").tobytes(),
        duration_s=60.0 / parameters.turns_a_minute * beams / parameters.steps_a_turn,
    )


def _make(request: SourceRequest) -> HokuyoLaser:
    return HokuyoLaser(request.device, request.url, request.now_s)


SOURCES: Final = (
    SourceKind(
        "hokuyo",
        ("laser",),
        "hokuyo:///dev/ttyACM0, or hokuyo://192.168.0.10:10940",
        _make,
        {**BAUD_OPTION, **MOUNT},
        group=SERIAL_GROUP,
    ),
)
