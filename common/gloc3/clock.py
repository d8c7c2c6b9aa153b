"""Time: the only reader of the wall clock, and the event loop whose clock jumps.

`t_s` is monotonic seconds since boot of the platform's clock host. In both kinds of time it is `loop.time()` of the
asyncio event loop, and everything is scheduled with the loop's `call_at` and `call_later`:

* *Wall* time is an ordinary asyncio loop.
* *Virtual* time is a `VirtualLoop`: when nothing is ready it jumps to the next timer. It starts at 0, with a fixed UTC.
"""

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime
from typing import Any, Final, TypeVar

from gloc3.errors import Misuse

T = TypeVar("T")

VIRTUAL_EPOCH_S: Final = datetime(2026, 1, 1, tzinfo=UTC).timestamp()
"""UTC at which virtual time starts, in seconds since 1970."""


class Clock:
    """The time of one process: `now_s()`, and what turns it into UTC for people and logs."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.is_virtual: Final = isinstance(loop, VirtualLoop)
        self.now_s: Final[Callable[[], float]] = loop.time
        """Seconds since boot of the clock host."""
        self.utc_offset_s: Final = VIRTUAL_EPOCH_S if self.is_virtual else time.time() - loop.time()
        """Add it to `now_s()` for seconds since 1970. Recorded once a log, never used in control."""

    @staticmethod
    def cost_s() -> float:
        """A stopwatch for measured costs, in seconds from an arbitrary start; never part of a log in virtual time."""
        return time.perf_counter()


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop without waiting: its clock jumps to the next timer when nothing is ready.

    It serves one process without sockets. `run_in_executor` runs its function at once, in the loop's thread, so that
    the order of everything is fixed.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        super().__init__(_JumpingSelector(self))

    def time(self) -> float:
        """Virtual seconds since the start."""
        return self._now_s

    def jump(self, timeout_s: float | None) -> None:
        """Moves the clock to the next timer; called by the selector when nothing is ready."""
        if timeout_s is None:
            raise Misuse("virtual time stands still: nothing is scheduled, and somebody waits")
        if timeout_s > 0.0:
            timers: list[asyncio.TimerHandle] = self._scheduled  # type: ignore[attr-defined] # asyncio's heap of timers
            self._now_s = timers[0].when()

    def run_in_executor(self, executor: Any, func: Callable[..., T], *args: Any) -> asyncio.Future[T]:  # type: ignore[override] # noqa: ARG002
        """Runs `func` now; there are no threads in virtual time."""
        future: asyncio.Future[T] = self.create_future()
        future.set_result(func(*args))
        return future


class _JumpingSelector(selectors.DefaultSelector):  # type: ignore[misc,valid-type] # the class depends on the system
    """Never waits: tells its loop to jump instead."""

    def __init__(self, loop: VirtualLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._loop.jump(timeout)
        return []


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Runs a coroutine in virtual time to its end, in a fresh loop."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
