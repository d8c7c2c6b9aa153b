"""Paces simulated time by the wall clock: waits when early, catches up when late."""

from typing import Final

MOST_BEHIND_S: Final = 2.0
"""What is later than this is not caught up with: the time of the flight slips."""


class RealTimePacer:
    """Computes how long to wait for a simulated time.

    A companion maps its autopilot's clock to its own by the quickest messages. If time that is lost once were lost for good,
    all that comes later would seem old.

    Args:
        speed: simulated seconds to one of the wall clock.
    """

    def __init__(self, speed: float) -> None:
        self.slips = 0
        """Number of times that it gave up catching up."""
        self._speed: Final = speed
        self._begin_s = float("-inf")
        self._last_s = 0.0

    def wait_s(self, now_s: float, simulated_s: float) -> float:
        """Wait until a simulated time is due, s; not positive if it is due.

        Args:
            now_s: the wall clock.
            simulated_s: simulated time; a step back restarts the pacing.
        """
        if simulated_s < self._last_s or self._begin_s == float("-inf"):
            self._begin_s = now_s - simulated_s / self._speed
        self._last_s = simulated_s
        wait_s = self._begin_s + simulated_s / self._speed - now_s
        if wait_s < -MOST_BEHIND_S:
            self.slips += 1
            self._begin_s = now_s - simulated_s / self._speed
            return 0.0
        return wait_s
