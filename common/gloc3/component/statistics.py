"""Cycle statistics of a component: rate, cost, overruns."""


class CycleStatistics:
    """Counts cycles; `close_window()` measures rate and mean cost since it was last called."""

    def __init__(self) -> None:
        self.cycles = 0
        self.overruns = 0
        self.max_s = 0.0
        self.rate_hz = 0.0
        """Cycles per second in the last closed window."""
        self._mean_s: float | None = None
        """Mean cost in the last closed window that had a cycle."""
        self._window_total_s = 0.0
        self._window_cycles = 0
        self._window_start_s = 0.0

    def restart(self, now_s: float) -> None:
        """Begins anew to measure the rate, as at a start of the component."""
        self.rate_hz = 0.0
        self._window_cycles, self._window_total_s = 0, 0.0
        self._window_start_s = now_s

    def add(self, cost_s: float) -> None:
        """Counts a cycle that has ended."""
        self.cycles += 1
        self._window_cycles += 1
        self._window_total_s += cost_s
        if cost_s > self.max_s:
            self.max_s = cost_s

    @property
    def mean_s(self) -> float:
        """Mean cost of a cycle of the last window, in seconds; in the first one, of those so far."""
        if self._mean_s is not None:
            return self._mean_s
        return self._window_total_s / self._window_cycles if self._window_cycles else 0.0

    def close_window(self, now_s: float, least_s: float) -> None:
        """Measures since the last window or the start, if that is at least so long ago."""
        span_s = now_s - self._window_start_s
        if span_s >= least_s:
            rate_hz = self._window_cycles / span_s
            if self._window_cycles:
                self._mean_s = self._window_total_s / self._window_cycles
            self.restart(now_s)
            self.rate_hz = rate_hz
