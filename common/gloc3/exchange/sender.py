"""A thread that sends what may have to wait, so that a link which takes nothing more holds up no loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Condition, Thread
from typing import Final

from gloc3.component.guard import guard

LEAVE_S: Final = 1.0
"""What waits may take so long to leave when everything ends."""

Send = Callable[[], None]


class Sender:
    """Sends messages one after the other, in the order in which they were given.

    Args:
        name: of the thread.
        depth: so many may wait.
        failed: is told, in the thread, of a message that could not be sent.
    """

    def __init__(self, name: str, depth: int, failed: Callable[[BaseException], None]) -> None:
        self._depth = depth
        self._failed = failed
        self._waiting: deque[Send] = deque()
        self._changed = Condition()
        self._is_idle = False
        self._is_open = True
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def give(self, send: Send) -> bool:
        """Takes a message over, unless the queue is full; never waits."""
        if len(self._waiting) >= self._depth:
            return False
        self._waiting.append(send)
        if self._is_idle:
            with self._changed:
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
            try:
                send = self._waiting.popleft()
            except IndexError:
                if not self._rest():
                    return
                continue
            _, error = guard(send)
            if error is not None:
                self._failed(error)

    def _rest(self) -> bool:
        """Waits for a message; False when none will come any more."""
        with self._changed:
            self._is_idle = True  # before the look: who gives one after it will notify
            while not self._waiting:
                if not self._is_open:
                    return False
                self._changed.wait()
            self._is_idle = False
            return True
