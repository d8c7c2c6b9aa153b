"""Narration: lines for people on stderr, which never disturb the work that they tell of."""

import queue
import sys
import threading
from contextlib import suppress
from typing import Final

MOST_WAITING: Final = 1000
"""Lines that wait for a stderr that takes none at the moment; further ones are lost."""
LAST_WORDS_S: Final = 1.0
"""How long the last lines may take to get out."""


def narrate(text: str) -> None:
    """Writes a line on stderr; that nobody reads there any more is no reason to stop."""
    with suppress(OSError, ValueError):
        sys.stderr.write(text + "\n")
        sys.stderr.flush()


class Narrator:
    """Narrates from a thread of its own: a terminal that is held up must not hold up a vehicle."""

    def __init__(self) -> None:
        self._lines: queue.Queue[str | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write, name="narrator", daemon=True)
        self._thread.start()

    def say(self, text: str) -> None:
        """Has a line written soon."""
        with suppress(queue.Full):
            self._lines.put_nowait(text)

    def close(self) -> None:
        """Waits for what has been said, but not long."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
            self._thread.join(LAST_WORDS_S)

    def _write(self) -> None:
        while (text := self._lines.get()) is not None:
            narrate(text)
