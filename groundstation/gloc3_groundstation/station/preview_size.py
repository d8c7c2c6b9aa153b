"""Preview size for a link: grows while pictures arrive in time, shrinks when they do not."""

from typing import Final

SIZES: Final = ((64, 48), (96, 72), (128, 96), (192, 144), (256, 192), (320, 240), (480, 360), (640, 480))
"""Columns and half lines that are tried, one after the other."""
RATE_HZ: Final = 1.0
SOON_S: Final = 1.6
"""A picture that comes so soon after the one before was no burden."""
LATE_S: Final = 3.5
ENOUGH: Final = 4
"""So many in time, one after the other, and a larger one is tried."""


class PreviewSize:
    """Learns from when pictures come."""

    def __init__(self) -> None:
        self._step = 0
        self._most = len(SIZES) - 1
        self._in_time = 0
        self._came_s: float | None = None

    def size(self, room: tuple[int, int]) -> tuple[int, int]:
        """Size to request for the pixels that can be shown; the smallest where even that is too large."""
        fitting = [size for size in SIZES[: self._step + 1] if size[0] <= room[0] or size[1] <= room[1]]
        return fitting[-1] if fitting else SIZES[0]

    def came(self, now_s: float) -> None:
        """A picture has come."""
        gap_s = now_s - self._came_s if self._came_s is not None else SOON_S
        self._came_s = now_s
        if gap_s > LATE_S:
            self._most = max(0, self._step - 1) if self._step else self._most
            self._step = max(0, self._step - 1)
            self._in_time = 0
        elif gap_s <= SOON_S:
            self._in_time += 1
            if self._in_time >= ENOUGH and self._step < self._most:
                self._step += 1
                self._in_time = 0

    def pause(self) -> None:
        """Pauses the measurement: the next picture's delay says nothing about the link."""
        self._came_s = None
