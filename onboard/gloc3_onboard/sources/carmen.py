"""Laser logs (CARMEN, GMapping, BreezySLAM) as recorded data."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import msgspec

from gloc3.messages.perception import LaserScan
from gloc3_onboard.datasets.laser_logs import read_laser_log
from gloc3_onboard.sources.replay import Recorded


def scan_records(path: Path, name: str, max_m: float | None = None) -> Sequence[Recorded[LaserScan]]:
    """The scans of a log.

    Args:
        path: the file, or a folder with one.
        name: of the scanner.
        max_m: a range at or past it is nothing seen; None for what is usual for the kind of log.

    Raises:
        InputError: it is damaged.
        Refused: it is no such log.
    """
    log = read_laser_log(path, max_m)
    return [Recorded(t_s, partial(_named, scan.scan, name)) for t_s, scan in zip(log.times_s, log.scans, strict=True)]


def _named(scan: LaserScan, name: str) -> LaserScan:
    return msgspec.structs.replace(scan, scanner=name)
