"""Values over hours in bounded memory: every sample of the last minutes, then extremes over increasing intervals.

A `Ring` keeps the last rows of a table, oldest first, as one block of memory. A `History` has one for all samples and
one for each `Level`, whose rows hold the extremes of an interval: a peak of one sample is still visible hours later.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

FIRST_ROWS: Final = 64


class Ring:
    """The last `most` rows, each with its time."""

    def __init__(self, columns: int, most: int) -> None:
        self.most: Final = most
        self._times = np.empty(min(FIRST_ROWS, 2 * most), np.float64)
        self._rows = np.empty((len(self._times), columns), np.float32)
        self._begin = self._end = 0

    def __len__(self) -> int:
        return self._end - self._begin

    @property
    def times_s(self) -> Floats:
        """The rows' times, rising."""
        return self._times[self._begin : self._end]

    @property
    def rows(self) -> Singles:
        """The rows, oldest first."""
        return self._rows[self._begin : self._end]

    @property
    def bytes(self) -> int:
        """The memory it takes."""
        return self._times.nbytes + self._rows.nbytes

    def append(self, t_s: float, row: Singles) -> None:
        """Adds a row; the oldest goes when there are too many."""
        if self._end == len(self._times):
            self._make_room()
        self._times[self._end], self._rows[self._end] = t_s, row
        self._end += 1
        if self._end - self._begin > self.most:
            self._begin += 1

    def clear(self) -> None:
        """Forgets all rows."""
        self._begin = self._end = 0

    def _make_room(self) -> None:
        """Moves the rows to the front of a block of twice the size, up to twice the number of rows kept."""
        size, count = min(2 * len(self._times), 2 * self.most), len(self)
        times, rows = np.empty(size, np.float64), np.empty((size, self._rows.shape[1]), np.float32)
        times[:count], rows[:count] = self.times_s, self.rows
        self._times, self._rows, self._begin, self._end = times, rows, 0, count


class HistoryLevel(NamedTuple):
    """Resolution of values beyond the last minutes."""

    period_s: float
    """Interval covered by a row."""
    rows: int
    """So many are kept."""


class HistorySeries(NamedTuple):
    """Values over time, one or a range for each moment; NaN where there is none."""

    times_s: Floats
    lows: Singles
    highs: Singles
    step_s: float
    """Interval covered by a point; 0 where each is one sample."""

    @property
    def last(self) -> float | None:
        """The newest value that there is."""
        known = self.highs[~np.isnan(self.highs)]
        return float(known[-1]) if len(known) else None


class History:
    """The values of some channels over hours."""

    def __init__(self, channels: int, samples: int, levels: Sequence[HistoryLevel]) -> None:
        """A history.

        Args:
            channels: how many values a sample has.
            samples: how many are kept as they came.
            levels: how older ones are kept, the finest first.
        """
        self._channels: Final = channels
        self._samples = Ring(channels, samples)
        self._levels = [(level, Ring(2 * channels, level.rows)) for level in levels]
        self._open: list[Singles | None] = [None] * len(self._levels)
        self._open_s = [0.0] * len(self._levels)

    @property
    def samples(self) -> Ring:
        """The last samples as they came."""
        return self._samples

    @property
    def bytes(self) -> int:
        """The memory it takes."""
        return self._samples.bytes + sum(ring.bytes for _, ring in self._levels)

    def append(self, t_s: float, values: Singles) -> None:
        """Adds a sample; NaN for unknown values. One that is not later than the last is ignored."""
        if len(self._samples) and t_s <= self._samples.times_s[-1]:
            return
        self._samples.append(t_s, values)
        for index, (level, ring) in enumerate(self._levels):
            start_s, extremes = t_s - t_s % level.period_s, self._open[index]
            if extremes is not None and start_s == self._open_s[index]:
                np.fmin(extremes[: self._channels], values, out=extremes[: self._channels])
                np.fmax(extremes[self._channels :], values, out=extremes[self._channels :])
                continue
            if extremes is not None:
                ring.append(self._open_s[index] + level.period_s / 2.0, extremes)
            self._open[index], self._open_s[index] = np.concatenate((values, values)), start_s

    def clear(self) -> None:
        """Forgets everything."""
        self._samples.clear()
        for _, ring in self._levels:
            ring.clear()
        self._open = [None] * len(self._levels)

    def series(self, channel: int, from_s: float, to_s: float, points: int) -> HistorySeries:
        """A channel over a time range, in about `points` points at most, from the finest level that covers it."""
        times_s, lows, highs, step_s = self._record(channel, from_s)
        begin, end = np.searchsorted(times_s, (from_s, to_s), side="left")
        begin, end = max(0, begin - 1), min(len(times_s), end + 1)
        times_s, lows, highs = times_s[begin:end], lows[begin:end], highs[begin:end]
        if len(times_s) <= points or to_s <= from_s:
            return HistorySeries(times_s, lows, highs, step_s)
        step_s = max(step_s, (to_s - from_s) / points)
        slots = np.floor(times_s / step_s)  # of absolute time, so that points do not change while the window moves
        starts = np.flatnonzero(np.diff(slots, prepend=np.nan))
        return HistorySeries(
            (slots[starts] + 0.5) * step_s, np.fmin.reduceat(lows, starts), np.fmax.reduceat(highs, starts), step_s
        )

    def _record(self, channel: int, from_s: float) -> tuple[Floats, Singles, Singles, float]:
        samples = self._samples
        is_whole = len(samples) < samples.most
        if is_whole or samples.times_s[0] <= from_s or not self._levels:
            values = samples.rows[:, channel]
            return samples.times_s, values, values, 0.0
        reaching = [(level, ring) for level, ring in self._levels if len(ring) < ring.most or ring.times_s[0] <= from_s]
        level, ring = reaching[0] if reaching else self._levels[-1]
        rows, index = ring.rows, channel + self._channels
        newest = samples.times_s > (ring.times_s[-1] + level.period_s / 2.0 if len(ring) else -np.inf)
        fresh = samples.rows[newest, channel]
        return (
            np.concatenate((ring.times_s, samples.times_s[newest])),
            np.concatenate((rows[:, channel], fresh)),
            np.concatenate((rows[:, index], fresh)),
            level.period_s,
        )
