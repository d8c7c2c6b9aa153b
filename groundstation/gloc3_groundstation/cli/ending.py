"""End of a session: at a signal or when its terminal is gone, and of the process itself where the session does not close.

A terminal that takes no more output blocks whatever writes to it. Therefore the deadline is the kernel's timer, whose
signal ends the process, and the signals' handlers and the watch of the terminal do not need a free event loop.
"""

import asyncio
import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

CLOSES_WITHIN_S: Final = 10.0
"""Longest time from the first request to end until the session has closed, s."""
SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Ending:
    """A session's end; use it as a context around the event loop.

    Args:
        within_s: time for the session to close, s; then SIGALRM ends the process.
    """

    def __init__(self, within_s: float = CLOSES_WITHIN_S) -> None:
        self._within_s = within_s

    def __enter__(self) -> "Ending":
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def begin(self) -> None:
        """Begins the time for the session to close; later calls change nothing."""
        if not signal.getitimer(signal.ITIMER_REAL)[0]:
            signal.setitimer(signal.ITIMER_REAL, self._within_s)

    @contextmanager
    def requested(self, end: Callable[[], object], terminal: int | None = None) -> Iterator[None]:
        """Calls `end` in the running event loop at Ctrl-C, SIGTERM or SIGHUP, or when the terminal is gone.

        A SIGHUP that was ignored at the start stays so, as with nohup.

        Args:
            end: has the session end.
            terminal: file descriptor of the session's terminal; None where it needs none.
        """
        loop = asyncio.get_running_loop()

        def request() -> None:
            self.begin()
            loop.call_soon_threadsafe(end)

        def handle(number: int, frame: FrameType | None) -> None:
            del number, frame
            request()

        numbers = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
        before = {number: signal.signal(number, handle) for number in numbers}
        stop, stopped = os.pipe()
        watch = threading.Thread(target=_watch, args=(terminal, stop, request), name="terminal-watch", daemon=True)
        if terminal is not None:
            watch.start()
        try:
            yield
        finally:
            os.close(stopped)
            if terminal is not None:
                watch.join()
            os.close(stop)
            for number, handler in before.items():
                signal.signal(number, handler)


def _watch(terminal: int, stop: int, gone: Callable[[], None]) -> None:
    """Waits until a terminal hangs up, or until the other end of a pipe is closed."""
    poll = select.poll()
    poll.register(terminal, 0)  # hang-ups and errors are always reported
    poll.register(stop, 0)
    found = poll.poll()
    if all(descriptor != stop for descriptor, _ in found):
        gone()
