"""Progress of a service, for display."""

from collections.abc import Callable
from typing import TypeAlias

import msgspec


class JobProgress(msgspec.Struct, frozen=True, kw_only=True):
    """Progress of a running job."""

    what: str
    """Running operation, such as "listing the parameters"."""
    fraction: float | None = None
    """From 0 to 1; None while it is unknown."""
    detail: str = ""
    """Figures for a person, as "120 of 900"."""


OnProgress: TypeAlias = Callable[[JobProgress], None]


def no_progress(progress: JobProgress) -> None:
    """Ignores progress."""
    del progress


class Quietly:
    """Passes progress on when it has changed.

    Args:
        listener: receives the progress.
    """

    def __init__(self, listener: OnProgress | None) -> None:
        self._listener = listener or no_progress
        self._last: JobProgress | None = None

    def __call__(self, what: str, fraction: float | None = None, detail: str = "") -> None:
        """Passes progress on if it has changed."""
        progress = JobProgress(what=what, fraction=fraction, detail=detail)
        if progress != self._last:
            self._last = progress
            self._listener(progress)
