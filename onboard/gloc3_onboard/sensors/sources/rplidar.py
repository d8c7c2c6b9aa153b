"""Slamtec's RPLIDAR A1, A2 and A3 by Adafruit's library, which comes with `pip install gloc3[laser]`."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Gloc3Error
from gloc3.messages.perception import LaserScan
from gloc3_onboard.sensors.devices import StampedScan
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import BAUD as BAUD_OPTION
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, Number, SourceUrl, device_problem
from gloc3_onboard.sensors.sources.laser import MOUNT, mounted_scan
from gloc3_onboard.sensors.threaded import ThreadedSource

BAUD: Final = 115_200
"""Of the A1 and A2; the A3 has 256000."""
BEAMS: Final = 360
MIN_M: Final = 0.15
MAX_M: Final = 12.0
LEAST_POINTS: Final = 30
"""A turn with fewer is one that was cut off."""
SILENT_S: Final = 1.0


class RpLidar(ThreadedSource[StampedScan]):
    """A scanner on a serial line; its points are binned into beams of one degree.

    Args:
        name: name of the device.
        url: `rplidar:///dev/ttyUSB0`.
        now_s: our time.
    """

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first."""
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedScan | None]]:
        """Opens the line and starts the motor."""
        path = self._url.place
        problem = device_problem(Path(path), SERIAL_GROUP)
        if problem:
            raise Gloc3Error(f"{self.name}: {problem}")
        lidar_type, failure = _library(self.name)
        try:
            lidar = lidar_type(None, path, baudrate=int(self._url.number("baud", BAUD)), timeout=SILENT_S)
        except (failure, OSError) as error:
            raise Gloc3Error(f"{self.name}: {path}: {error}") from error
        try:
            lidar.stop()
            measurements = lidar.iter_measurements(max_buf_meas=5 * BEAMS)
            first = next(measurements)
            yield self._turns(first, measurements, failure)
        except failure as error:
            raise Gloc3Error(f"{self.name}: {path} does not answer as an RPLIDAR does: {error}") from error
        finally:
            with suppress(failure, OSError):
                lidar.stop()
                lidar.stop_motor()
            lidar.disconnect()

    def _turns(self, first: Any, measurements: Iterator[Any], failure: type[Exception]) -> Iterator[StampedScan]:
        points: list[tuple[float, float]] = []
        begin_s = self.now_s()
        try:
            for is_new, _, angle_deg, distance_mm in _chain(first, measurements):
                if is_new:
                    now_s = self.now_s()
                    if len(points) >= LEAST_POINTS:
                        scan = scan_of(self.name, points, now_s - begin_s, self._url.number("max_m", MAX_M))
                        yield mounted_scan(now_s, scan, self._url)
                    points, begin_s = [], now_s
                points.append((angle_deg, distance_mm))
        except failure as error:
            raise Gloc3Error(f"{self.name}: {error}") from error


def _chain(first: Any, rest: Iterator[Any]) -> Iterator[Any]:
    yield first
    yield from rest


def _library(name: str) -> tuple[Any, type[Exception]]:
    """The library's class and its exception."""
    try:
        from adafruit_rplidar import RPLidar, RPLidarException
    except (ImportError, NotImplementedError) as error:
        raise Gloc3Error(f"{name}: rplidar:// needs a library: pip install 'gloc3[laser]' ({error})") from error

    class Lidar(RPLidar):  # type: ignore[misc] # the library has no types
        """A scanner whose motor may lack a control line: adapters without DTR keep it turning."""

        def _control_motor(self, val: bool) -> None:
            with suppress(OSError):
                super()._control_motor(val)

    return Lidar, RPLidarException


def scan_of(name: str, points: list[tuple[float, float]], duration_s: float, max_m: float) -> LaserScan:
    """A turn as a scan of one beam a degree.

    Args:
        name: of the scanner.
        points: degrees, clockwise from ahead, and millimetres; 0 is no reading.
        duration_s: of the turn.
        max_m: beyond it nothing is seen.
    """
    table: NDArray[np.float64] = np.array(points, float).reshape(-1, 2)
    beam = np.rint(-table[:, 0]).astype(int) % BEAMS
    ranges = np.zeros(BEAMS, np.float32)
    has_reading = table[:, 1] > 0.0
    far_first = np.argsort(-table[:, 1])
    chosen = far_first[has_reading[far_first]]  # of several points in a beam the nearest is kept
    ranges[beam[chosen]] = table[chosen, 1] * 1e-3
    half = BEAMS // 2
    return LaserScan(
        scanner=name,
        angle_min_rad=-math.pi,
        angle_step_rad=math.tau / BEAMS,
        range_min_m=MIN_M,
        range_max_m=max_m,
        ranges_m=np.roll(ranges, half).astype("<f4").tobytes(),
        duration_s=duration_s,
    )


def _make(request: SourceRequest) -> RpLidar:
    return RpLidar(request.device, request.url, request.now_s)


def _library_problem() -> str:
    if find_spec("adafruit_rplidar") is None:
        return "its library is not installed; pip install 'gloc3[laser]'"
    return ""


SOURCES: Final = (
    SourceKind(
        "rplidar",
        ("laser",),
        "rplidar:///dev/ttyUSB0",
        _make,
        {**BAUD_OPTION, "max_m": Number(1, 100), **MOUNT},
        group=SERIAL_GROUP,
        problem=_library_problem,
    ),
)
