"""A thread that sends what must arrive, so that a link which takes nothing more holds up no loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from threading import Condition, Thread
from typing import Any, Final

from gloc3.guard import guard

WAITING: Final = 4096
"""So many messages may wait for a link."""
LEAVE_S: Final = 1.0
"""What waits may take so long to leave when everything ends."""

Send = Callable[..., None]


class Sender:
    """Sends messages one after the other, in the order in which they were given.

    Args:
        name: of the thread.
        failed: is told, in the thread, of a message that could not be sent.
    """

    def __init__(self, name: str, failed: Callable[[BaseException], None]) -> None:
        self._failed = failed
        self._waiting: deque[tuple[Send, Any, Any]] = deque()
        self._changed = Condition()
        self._is_open = True
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def give(self, send: Send, payload: Any, attachment: Any) -> bool:
        """Takes a message over, unless the queue is full; never waits."""
        if len(self._waiting) >= WAITING:
            return False
        with self._changed:
            self._waiting.append((send, payload, attachment))
            self._changed.notify()
        return True

    def close(self) -> None:
        """Ends when everything has been sent, or after a while without that."""
        with self._changed:
            self._is_open = False
            self._changed.notify()
        self._thread.join(LEAVE_S)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._waiting:
                    if not self._is_open:
                        return
                    self._changed.wait()
                send, payload, attachment = self._waiting.popleft()
            _, error = guard(partial(send, payload, attachment=attachment))
            if error is not None:
                self._failed(error)
