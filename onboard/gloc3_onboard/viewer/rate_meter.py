"""How often something happens, from a count that is looked at now and then."""

from collections import deque
from typing import Final

WINDOW_S: Final = 5.0
STEP_S: Final = 0.45


class RateMeter:
    """Measures over the last five seconds, or for as long as it looks."""

    __slots__ = ("_looks",)

    def __init__(self, now_s: float) -> None:
        self._looks: deque[tuple[float, int]] = deque([(now_s, 0)])

    def rate_hz(self, count: int, now_s: float) -> float:
        """The rate, given how often it has happened since the begin."""
        looks = self._looks
        while len(looks) > 1 and now_s - looks[1][0] >= WINDOW_S:
            looks.popleft()
        first_s, first = looks[0]
        if now_s - looks[-1][0] >= STEP_S:
            looks.append((now_s, count))
        return (count - first) / (now_s - first_s) if now_s > first_s else 0.0
