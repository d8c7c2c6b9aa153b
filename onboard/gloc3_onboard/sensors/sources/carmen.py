"""Laser logs (CARMEN, GMapping, BreezySLAM) as recorded data."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.messages.perception import LaserScan
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded
from gloc3_onboard.sensors.source_url import REPLAY, Number


def scan_records(path: Path, name: str, max_m: float | None = None) -> Sequence[Recorded[LaserScan]]:
    """The scans of a log.

    Args:
        path: the file, or a folder with one.
        name: name of the scanner.
        max_m: ranges from here on mean no echo; None for the default of the kind of log.

    Raises:
        InputError: the log is damaged.
        Refused: not such a log.
    """
    from gloc3_onboard.datasets.laser_logs import read_laser_log

    log = read_laser_log(path, max_m)
    return [Recorded(t_s, partial(_named, scan.scan, name)) for t_s, scan in zip(log.times_s, log.scans, strict=True)]


def _named(scan: LaserScan, name: str) -> LaserScan:
    return msgspec.structs.replace(scan, scanner=name)


def _make(request: SourceRequest) -> Any:
    max_m = request.url.number("max_m", 0.0) or None
    return request.replayed(partial(scan_records, request.path, request.device, max_m))


SOURCES: Final = (
    SourceKind(
        "carmen",
        ("laser",),
        "carmen://aces.log",
        _make,
        {**REPLAY, "max_m": Number(0.5, 1000.0)},
        is_file=True,
    ),
)
