"""Notices that nothing comes any more."""

from typing import Final

SILENT_S: Final = 1.0
"""Without anything for so long a processor says that nothing comes."""


class InputSilence:
    """Follows one input of a processor: silence is to be told once in each period of it."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def end(self, now_s: float) -> None:
        """Something has come."""
        self._since_s = now_s

    def is_due(self, now_s: float) -> bool:
        """Whether nothing has come for a period, or for another one."""
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s < SILENT_S:
            return False
        self._since_s = now_s
        return True
