"""A component that leaks for real."""

from collections.abc import Sequence

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Result
from gloc3.component.settings import NoSettings

PIECES, PIECE_BYTES = 4_000, 2_000
"""What it keeps in each cycle."""


class Leaker(DataProcessor[NoSettings]):
    """Keeps everything that it makes."""

    def __init__(self) -> None:
        self._kept: list[bytes] = []

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Makes more."""
        self._kept += [bytes(PIECE_BYTES) for _ in range(PIECES)]
        return []
