"""An event loop for a router: what some sockets have heard is passed on in the moment of waking, before anything else.

An asyncio loop makes a handle of each event, puts it into a queue and looks at its timers before it calls anybody. That
costs more than to pass on a MAVLink frame. Here who reads promptly is called by the wait itself, on the same thread;
all else is as in asyncio.
"""

from __future__ import annotations

import asyncio
import math
import os
import select
import selectors
from collections.abc import Callable
from contextvars import Context
from typing import Any, Final, TypeVarTuple

from gloc3.clock import monotonic_s
from gloc3.guard import guard

Ts = TypeVarTuple("Ts")

MOST_EVENTS: Final = 64
"""What more has happened is told by the next wait."""


class _Selector(selectors.EpollSelector):
    """Waits as asyncio wants it, and calls the prompt readers itself.

    Args:
        now_s: the loop's time.
        failed: told of what a reader has raised.
    """

    def __init__(self, now_s: Callable[[], float], failed: Callable[[BaseException], None]) -> None:
        super().__init__()
        self.is_asked = False
        """Whether the loop was given something to do since the wait began."""
        self.readers: dict[int, Callable[[], None]] = {}
        """By their file's number."""
        self._now_s, self._failed = now_s, failed
        self._epoll = select.epoll.fromfd(os.dup(self.fileno()))

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, Any]]:
        """What has happened, without what a prompt reader has dealt with; while that is all, it waits on."""
        wait_s = -1.0 if timeout is None else math.ceil(timeout * 1e3) * 1e-3 if timeout > 0.0 else 0.0
        self.is_asked = False
        ready, error = guard(self._wait, wait_s)
        if error is not None:
            self._failed(error)
        return ready or []

    def _wait(self, wait_s: float) -> list[tuple[selectors.SelectorKey, Any]]:
        until_s, poll, readers = self._now_s() + wait_s, self._epoll.poll, self.readers
        while True:
            try:
                happened = poll(wait_s, MOST_EVENTS)
            except InterruptedError:
                return []
            ready: list[tuple[selectors.SelectorKey, Any]] = []
            for number, events in happened:
                if number in readers:
                    readers[number]()
                else:
                    ready += self._ready(number, events)
            if ready or self.is_asked or not happened:
                return ready
            if wait_s >= 0.0 and (wait_s := until_s - self._now_s()) <= 0.0:
                return ready

    def _ready(self, number: int, events: int) -> list[tuple[selectors.SelectorKey, Any]]:
        key = self.get_map().get(number)
        if key is None:  # closed by who was called just before
            return []
        mask = (selectors.EVENT_WRITE if events & ~select.EPOLLIN else 0) | (
            selectors.EVENT_READ if events & ~select.EPOLLOUT else 0
        )
        return [(key, mask & key.events)] if mask & key.events else []

    def close(self) -> None:
        """Waits no more."""
        self._epoll.close()
        super().close()


class PromptLoop(asyncio.SelectorEventLoop):
    """The loop of a process that routes; Linux only."""

    time = staticmethod(monotonic_s)
    """As in asyncio, without a call in between."""

    def __init__(self) -> None:
        self._prompt = _Selector(self.time, self._fail)
        super().__init__(self._prompt)

    def read_promptly(self, file: int, reader: Callable[[], None]) -> None:
        """Has a reader called as soon as a file has something; `remove_reader` ends it."""
        self.add_reader(file, reader)
        self._prompt.readers[file] = reader

    def call_soon(
        self, callback: Callable[[*Ts], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """Has something called when the wait is over, which it is then."""
        self._prompt.is_asked = True
        return super().call_soon(callback, *args, context=context)

    def call_at(
        self, when: float, callback: Callable[[*Ts], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Has something called at a time, of which the wait must learn."""
        self._prompt.is_asked = True
        return super().call_at(when, callback, *args, context=context)

    def remove_reader(self, fd: Any) -> bool:
        """Calls a reader no more."""
        self._prompt.readers.pop(fd if isinstance(fd, int) else fd.fileno(), None)
        return super().remove_reader(fd)

    def _fail(self, error: BaseException) -> None:
        self.call_exception_handler({"message": "a prompt reader failed", "exception": error})
