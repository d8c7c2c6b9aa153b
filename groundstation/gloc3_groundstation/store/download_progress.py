"""Share, speed and remaining time of a download, in words."""

from collections import deque
from typing import Final

from gloc3_groundstation.station.wording import roughly

WINDOW: Final = 10
"""Updates over which the speed is averaged."""
POLL_PERIOD_S: Final = 1.0


class DownloadProgress:
    """One download; the speed of a resumed one counts only new data."""

    def __init__(self) -> None:
        self._polls: deque[tuple[float, int]] = deque(maxlen=WINDOW)

    def reset(self) -> None:
        """Restarts the speed measurement after a pause."""
        self._polls.clear()

    def words(self, here: int, size: int, now_s: float) -> str:
        """`42 % of 23.7 MB, 65 kB/s, 3 min to go`.

        Args:
            here: bytes that have come.
            size: bytes of the whole.
            now_s: the station's time.
        """
        if not self._polls or now_s - self._polls[-1][0] >= POLL_PERIOD_S:
            self._polls.append((now_s, here))
        share = 100.0 * here / size if size else 100.0
        text = f"{share:.0f} % of {amount(size)}"
        began_s, began = self._polls[0]
        elapsed_s = now_s - began_s
        if elapsed_s < POLL_PERIOD_S or here <= began:
            return text
        speed = (here - began) / elapsed_s
        return f"{text}, {amount(speed)}/s, {roughly((size - here) / speed)} to go"


def amount(number: float) -> str:
    """`812 bytes`, `65 kB`, `23.7 MB`."""
    return (
        f"{number:.0f} bytes"
        if number < 1e3
        else f"{number / 1e3:.0f} kB"
        if number < 1e6
        else f"{number / 1e6:.1f} MB"
    )
