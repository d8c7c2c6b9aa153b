"""Narration: lines for people on stderr, which never block the work that they describe.

Where stderr is the journal of systemd, each line begins with its level, `<4>` for a warning (sd-daemon(3)).
"""

import os
import queue
import sys
import threading
from contextlib import suppress
from typing import Final

from gloc3.documents.characters import printable

MOST_WAITING: Final = 1000
"""Lines that wait for a stderr that takes none at the moment; further ones are lost."""
LAST_LINES_S: Final = 1.0
"""How long the last lines may take to get out."""


ERROR: Final = 3
INFO: Final = 6


def narrate(text: str, level: int = INFO) -> None:
    """Writes lines on stderr; a closed stderr is ignored.

    Args:
        text: one or more lines.
        level: severity, as in syslog and MAVLink: 0 the worst, 7 the least.
    """
    text = printable(text)
    with suppress(OSError, ValueError):
        if is_journal():
            text = "\n".join(f"<{level}>{line}" for line in text.splitlines())
        sys.stderr.write(text + "\n")
        sys.stderr.flush()


def is_journal() -> bool:
    """Whether stderr goes to the systemd journal, by the device and inode that systemd states."""
    named = os.environ.get("JOURNAL_STREAM", "")
    if not named:
        return False
    try:
        status = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):  # it is no file
        return False
    return named == f"{status.st_dev}:{status.st_ino}"


class Narrator:
    """Narrates from its own thread, so that a blocked terminal does not block a vehicle."""

    def __init__(self) -> None:
        self._lines: queue.Queue[tuple[str, int] | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write, name="narrator", daemon=True)
        self._thread.start()

    def narrate(self, text: str, level: int = INFO) -> None:
        """Queues a line."""
        with suppress(queue.Full):
            self._lines.put_nowait((text, level))

    def close(self) -> None:
        """Waits a short time for pending lines to be written."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
            self._thread.join(LAST_LINES_S)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            narrate(*line)
