"""Laser logs: common types, and the reader of each file form.

Poses and motions are on level axes, x forward, y right, headings clockwise; most logs have them the other way round.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gloc3.errors import Finding, InputError, Refused
from gloc3.evaluation.trajectory import is_number
from gloc3.messages.perception import LaserScan
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

INTERVAL_S = 1.0
"""Scan interval of logs without times, s: such logs have usually been thinned out."""
LEAST_S = 0.001
"""Of scans whose times are out of order, each is so much later than the one before, s."""
DISORDERED = 0.2
"""Of a log with times this share of the steps goes back at most, and by no more than a usual step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedScan:
    """A scan as logged."""

    stamp_s: float
    """The log's own time."""
    scan: LaserScan
    pose: Planar | None = None
    """Pose logged with the scan: the truth in a corrected log."""
    wheels: Planar | None = None
    """Motion since the previous scan, by the wheels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserLog:
    """A laser log."""

    scans: Sequence[LoggedScan]
    has_times: bool
    """The times of the log grow, but for some that are out of order; where they do not, the scans are counted."""
    jitter_s: float = 0.0
    """Largest step back of the times, s."""

    @property
    def times_s(self) -> list[float]:
        """When each scan was taken."""
        if not self.has_times:
            return [INTERVAL_S * number for number in range(len(self.scans))]
        stamps = np.sort([scan.stamp_s for scan in self.scans])
        if self.jitter_s > 0.0:
            later = LEAST_S * np.arange(len(stamps))
            stamps = np.maximum.accumulate(stamps - later) + later
        times_s: list[float] = stamps.tolist()
        return times_s

    @property
    def has_wheels(self) -> bool:
        """Whether the log tells the motion of the wheels."""
        return any(scan.wheels is not None for scan in self.scans)


class LaserLogLine:
    """One line of a log, read word by word; errors are reported with their position."""

    def __init__(self, path: Path, number: int, text: str) -> None:
        self.words = text.split()
        self._path, self._number, self._text = path, number, text

    def wrong(self, index: int, message: str) -> InputError:
        """An error at a word; past the last one, at the end of the line."""
        starts = [match.start() for match in re.finditer(r"\S+", self._text)]
        column = starts[index] if index < len(starts) else len(self._text)
        finding = Finding(file=self._path.name, line=self._number, column=column + 1, message=message)
        return InputError([finding])

    def count(self, index: int) -> int:
        """A word that says how many numbers follow; the line must have them."""
        if index >= len(self.words) or not self.words[index].isdigit():
            raise self.wrong(index, "the number of readings is expected here")
        return int(self.words[index])

    def numbers(self, begin: int, end: int, *, may_be_nan: bool = False) -> Array:
        """Some words as numbers."""
        if end > len(self.words):
            raise self.wrong(len(self.words), f"the line ends after {len(self.words)} words; {end} are expected")
        try:
            found = np.array(self.words[begin:end], np.float64)
        except ValueError as error:
            index = next(index for index in range(begin, end) if not is_number(self.words[index]))
            raise self.wrong(index, f"{self.words[index]!r} is not a number") from error
        if not may_be_nan and not np.isfinite(found).all():
            raise self.wrong(begin + int(np.argmin(np.isfinite(found))), "this number is not finite")
        return found

    def number(self, index: int) -> float:
        """One word as a number."""
        return float(self.numbers(index, index + 1)[0])

    def pose(self, index: int) -> Planar:
        """Three words: x, y to the left, heading counter-clockwise."""
        x, y, heading = self.numbers(index, index + 3).tolist()
        return Planar(x, -y, -heading)


def scan_of(ranges_m: Array, angle_min_rad: float, angle_step_rad: float, range_max_m: float) -> LaserScan:
    """A scan of a log; a range that is too large for its number is infinite."""
    with np.errstate(over="ignore"):
        ranges = ranges_m.astype("<f4").tobytes()
    return LaserScan(
        scanner="log",
        angle_min_rad=angle_min_rad,
        angle_step_rad=angle_step_rad,
        range_min_m=0.05,
        range_max_m=range_max_m,
        ranges_m=ranges,
    )


def log_of(path: Path, scans: Sequence[LoggedScan]) -> LaserLog:
    """A log of some scans.

    Raises:
        InputError: there is none.
    """
    if not scans:
        raise InputError([Finding(file=path.name, line=0, column=0, message="there is no laser scan in it")])
    stamps = np.array([scan.stamp_s for scan in scans])
    steps = np.diff(stamps)
    jitter_s = max(0.0, float(-steps.min(initial=0.0)))
    has_times = not len(steps) or bool(np.mean(steps <= 0.0) <= DISORDERED and jitter_s <= np.median(steps))
    return LaserLog(scans=scans, has_times=has_times, jitter_s=jitter_s)


def file_of(dataset: Path) -> Path:
    """The log that a data set is: the file itself, or the only one of its kind in a folder.

    Raises:
        Refused: there is none, or more than one.
    """
    if not dataset.is_dir():
        return dataset
    for suffix in (".gfs", ".log", ".dat"):
        found = sorted(dataset.glob(f"*{suffix}"))
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(file.name for file in found)
            raise Refused(f"there is more than one log in {dataset}, name one of {names}")
    raise Refused(f"there is no laser log (.gfs, .log, .dat) in {dataset}")


def lines_of(path: Path) -> list[LaserLogLine]:
    """The lines of a file that say something.

    Raises:
        InputError: it is not text.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError([Finding(file=path.name, line=0, column=0, message="it is not text")]) from error
    lines = (
        LaserLogLine(path, number, line) for number, line in enumerate(text.splitlines(), 1) if not line.startswith("#")
    )
    return [line for line in lines if line.words]
