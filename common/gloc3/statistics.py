"""Cycle statistics of a component: rate, cost, overruns."""


class CycleStatistics:
    """Counts cycles; `take_rate_hz()` gives the rate since it was last asked."""

    def __init__(self) -> None:
        self.cycles = 0
        self.overruns = 0
        self.max_s = 0.0
        self._total_s = 0.0
        self._window_cycles = 0
        self._window_start_s = 0.0

    def restart(self, now_s: float) -> None:
        """Begins a new window, as at a start of the component."""
        self._window_cycles = 0
        self._window_start_s = now_s

    def add(self, cost_s: float) -> None:
        """Counts a cycle that has ended."""
        self.cycles += 1
        self._window_cycles += 1
        self._total_s += cost_s
        if cost_s > self.max_s:
            self.max_s = cost_s

    @property
    def mean_s(self) -> float:
        """Mean cost of a cycle, in seconds."""
        return self._total_s / self.cycles if self.cycles else 0.0

    def take_rate_hz(self, now_s: float) -> float:
        """Cycles per second since the last call."""
        span_s = now_s - self._window_start_s
        rate_hz = self._window_cycles / span_s if span_s > 0.0 else 0.0
        self.restart(now_s)
        return rate_hz
