"""A heap of timers as the lightest possible loop for protocol tests in virtual time."""

from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any


class QueueLoop:
    """Calls back in the order of time, then of asking; the clock jumps from one callback to the next."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._count = 0
        self._heap: list[tuple[float, int, Callable[..., Any], tuple[Any, ...]]] = []

    def time(self) -> float:
        return self.now_s

    def call_at(self, when: float, callback: Callable[..., Any], /, *args: Any) -> None:
        self._count += 1
        heappush(self._heap, (max(when, self.now_s), self._count, callback, args))

    def run(self, until_s: float, is_done: Callable[[], bool] = lambda: False) -> None:
        """Runs until nothing is left, `is_done`, or a time, whichever is first."""
        heap, standing = self._heap, 0
        while heap and heap[0][0] <= until_s and not is_done():
            standing = standing + 1 if heap[0][0] == self.now_s else 0
            assert standing < 100_000, f"time stands still at {self.now_s} s"
            self.now_s, _, callback, args = heappop(heap)
            callback(*args)
        if not is_done():
            self.now_s = max(self.now_s, until_s)
