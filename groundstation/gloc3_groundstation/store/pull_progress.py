"""Narrates the progress of a log download."""

import asyncio
from typing import Final

from gloc3.cli.narration import narrate
from gloc3_groundstation.store.download_progress import DownloadProgress

REPORT_PERIOD_S: Final = 2.0


class PullProgress:
    """See the module."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._title = ""
        self.begin("")

    def begin(self, title: str) -> None:
        """The next log."""
        self._title, self._pace, self._reported_s = title, DownloadProgress(), float("-inf")

    def update(self, _: str, here: int, size: int) -> None:
        """Some of it has come."""
        words = self._pace.words(here, size, self._loop.time())
        if here and self._loop.time() - self._reported_s >= REPORT_PERIOD_S:
            self._reported_s = self._loop.time()
            narrate(f"{self._title}: {words}")

    def pause(self, text: str) -> None:
        """Something is told meanwhile, as that the way is lost."""
        self._pace.reset()
        narrate(text)
