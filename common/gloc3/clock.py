"""Time: the only reader of the wall clock, and an event loop with virtual time.

`t_s` is monotonic seconds since boot of the platform's clock host. In both kinds of time it is `loop.time()` of the
asyncio event loop, and everything is scheduled with the loop's `call_at` and `call_later`:

* *Wall* time is an ordinary asyncio loop.
* *Virtual* time is a `VirtualLoop`: when nothing is ready it jumps to the next timer. It starts at 0, with a fixed UTC.
"""

import asyncio
import ctypes
import time
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from contextvars import Context
from datetime import UTC, datetime
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, Final, TypeVar, TypeVarTuple

from gloc3.component.workers import guard
from gloc3.errors import Misuse

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

monotonic_s: Final = time.monotonic
"""What asyncio's loops have for their time."""
VIRTUAL_EPOCH_S: Final = datetime(2026, 1, 1, tzinfo=UTC).timestamp()
"""UTC at which virtual time starts, in seconds since 1970."""
TASKS: Final = Path("/proc/self/task")
_TIMEX_BYTES: Final = 512
"""Room for `struct timex`; zeros change nothing."""
_CLOCK_NOT_SYNCHRONISED: Final = 5
"""TIME_ERROR."""


def utc_text(utc_s: float, form: str = "%Y-%m-%d %H:%M") -> str:
    """Formats a UTC time for display.

    Args:
        utc_s: seconds since 1970.
        form: a `strftime` format.
    """
    return datetime.fromtimestamp(utc_s, UTC).strftime(form)


def utc_now() -> datetime:
    """The computer's date and time, as for certificates; never used in control."""
    return datetime.now(UTC)


async def passed(seconds: float) -> None:
    """Waits this time on the running loop's clock, virtual or not."""
    await asyncio.sleep(seconds)


class Clock:
    """The time of one process: `now_s()`, and what turns it into UTC for people and logs."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.is_virtual: Final = isinstance(loop, VirtualLoop)
        self.now_s: Final[Callable[[], float]] = loop.time
        """Seconds since boot of the clock host."""
        self.utc_offset_s: Final = VIRTUAL_EPOCH_S if self.is_virtual else time.time() - loop.time()
        """Add it to `now_s()` for seconds since 1970. Recorded once a log, never used in control."""

    def utc_s(self) -> float:
        """Seconds since 1970 by the computer's clock, which may jump when it is set; never used in control."""
        return self.now_s() + VIRTUAL_EPOCH_S if self.is_virtual else time.time()

    def utc_offset(self) -> float | None:
        """What to add to `now_s()` now for seconds since 1970, for the tags of pictures; None while the clock may be wrong."""
        if self.is_virtual:
            return VIRTUAL_EPOCH_S
        return self.utc_s() - self.now_s() if self.is_utc_right() else None

    def is_utc_right(self) -> bool:
        """Whether the kernel reports the computer's clock as synchronized (NTP, GPS...).

        A computer without a real-time clock, common on vehicles, starts with a date in the past.
        """
        return self.is_virtual or _is_synchronised()

    @staticmethod
    def cost_s() -> float:
        """A stopwatch for measured costs, in seconds from an arbitrary start; never part of a log in virtual time."""
        return time.perf_counter()

    @staticmethod
    def processor_s() -> float:
        """The same of this process's time on a processor, which the load of a machine does not change."""
        return time.process_time()

    def starved_s(self) -> float:
        """Time for which threads of this process were ready and had no processor, in seconds, summed over them."""
        return 0.0 if self.is_virtual else starved_s()


def starved_s(tasks: Path = TASKS) -> float:
    """Sum of what the kernel tells of a process's threads.

    Args:
        tasks: a folder with a folder for each thread; without one (not Linux) nothing is known, and it is 0.
    """
    waited_ns = 0
    for file in tasks.glob("*/schedstat"):
        with suppress(OSError, ValueError, IndexError):
            waited_ns += int(file.read_text().split()[1])
    return waited_ns * 1e-9


def _is_synchronised() -> bool:
    """What `adjtimex(2)` says of the clock; true where there is no such call."""
    request = getattr(ctypes.CDLL(None), "adjtimex", None)
    return request is None or request(ctypes.create_string_buffer(_TIMEX_BYTES)) != _CLOCK_NOT_SYNCHRONISED


class _Call(asyncio.TimerHandle):
    """A scheduled call, cheaper to create and run than asyncio's: in a flight there are hundreds a second.

    Without a context it runs in that of the loop; tasks bring their own.
    """

    __slots__ = ()

    def __init__(
        self,
        when: float,
        callback: Callable[..., object],
        args: Any,
        loop: asyncio.AbstractEventLoop,
        context: Context | None,
    ) -> None:
        self._context: Any = context
        self._loop: Any = loop
        self._callback: Any = callback
        self._args: Any = args
        self._cancelled = self._scheduled = False
        self._repr = self._source_traceback = None
        self._when = when


class VirtualLoop(asyncio.BaseEventLoop):
    """An event loop without waiting: its clock jumps to the next timer when nothing is ready.

    It serves one process without sockets and threads. Timers that are due at the same moment run in the order in which
    they were made. `run_in_executor` runs its function at once, in the loop's thread, so that the order of everything
    is fixed. What callbacks raise does not end the loop, but is kept in `failures`.
    """

    _ready: "deque[_Call]"
    _stopping: bool
    _closed: bool

    def __init__(self) -> None:
        super().__init__()
        self._now_s = 0.0
        self._timers: list[tuple[float, int, _Call]] = []
        self._timers_made = 0
        self.failures: list[BaseException] = []
        """What callbacks raised, oldest first."""
        self.set_exception_handler(self._keep_failure)

    def time(self) -> float:
        """Virtual seconds since the start."""
        return self._now_s

    def call_at(
        self, when: float, callback: Callable[[*Ts], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Schedules a callback at a time; one in the past runs at once, after the callbacks that are ready."""
        if self._closed:
            self._check_closed()  # type: ignore[attr-defined] # asyncio's own, as in every loop built on its base
        timer = _Call(when, callback, args, self, context)
        self._timers_made += 1
        heappush(self._timers, (when, self._timers_made, timer))
        return timer

    def call_soon(
        self, callback: Callable[[*Ts], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """Schedules a callback after those that are ready."""
        if self._closed:
            self._check_closed()  # type: ignore[attr-defined] # asyncio's own
        call = _Call(self._now_s, callback, args, self, context)
        self._ready.append(call)
        return call

    def call_soon_threadsafe(
        self, callback: Callable[[*Ts], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """The same as `call_soon`: there are no other threads."""
        return self.call_soon(callback, *args, context=context)

    def run_in_executor(self, executor: Any, func: Callable[..., T], *args: Any) -> asyncio.Future[T]:  # type: ignore[override]
        """Runs `func` now; there are no threads in virtual time."""
        ended: asyncio.Future[Any] = self.create_future()
        result, error = guard(func, *args)
        if error is None:
            ended.set_result(result)
        else:
            ended.set_exception(error)
        return ended

    def _run_once(self) -> None:
        """Runs everything that is ready, or else jumps to the next moment at which something is; again until stopped."""
        ready, timers = self._ready, self._timers
        while True:
            if not ready and not self._stopping:
                while timers and timers[0][2]._cancelled:
                    heappop(timers)
                if not timers:
                    cause = self.failures[0] if self.failures else None
                    raise Misuse("virtual time is stuck: a task waits, but nothing is scheduled") from cause
                if timers[0][0] > self._now_s:
                    self._now_s = timers[0][0]
            now_s = self._now_s
            while timers and timers[0][0] <= now_s:
                timer = heappop(timers)[2]
                if not timer._cancelled:
                    ready.append(timer)
            for _ in range(len(ready)):
                call = ready.popleft()
                if call._cancelled:
                    continue
                if call._context is not None:
                    call._run()
                    continue
                _, error = guard(call._callback, *call._args)
                if error is not None:
                    self.call_exception_handler({"message": "a callback failed", "exception": error, "handle": call})
            if self._stopping:
                return

    def _write_to_self(self) -> None:
        """Nobody has to be woken."""

    def _keep_failure(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, BaseException) and "future" not in context:
            self.failures.append(error)
        else:
            loop.default_exception_handler(context)


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Runs a coroutine in virtual time to its end, in a fresh loop.

    Raises:
        Exception: what `main` raised, or else the first thing that a callback raised in the meantime.
    """
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        result = runner.run(main)
        loop = runner.get_loop()
        assert isinstance(loop, VirtualLoop)
        if loop.failures:
            raise loop.failures[0]
        return result
