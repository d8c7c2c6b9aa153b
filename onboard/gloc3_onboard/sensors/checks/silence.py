"""Notices that nothing comes any more."""

from typing import Final

SILENT_S: Final = 1.0
"""Time without input after which a processor reports silence, s."""


class InputSilence:
    """Silence monitor of one input; silence is reported once per period."""

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
