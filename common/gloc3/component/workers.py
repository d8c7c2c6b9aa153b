"""Workers: run a component's methods without delaying the control path.

In wall time each component has its own thread. In virtual time its methods run in the loop's thread, one after the
other as on a thread, and a model gives the cost of each. `guard` runs them: the one broad handler of the project.
"""

import asyncio
import os
import queue
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from math import floor, log2
from typing import Any, Final, NamedTuple, ParamSpec, Protocol, TypeVar

from gloc3.errors import Refused

REAL_TIME_PRIORITY: Final = 10
"""Of the event loop under SCHED_RR, from 1 to 99: below what the kernel and its drivers use (50)."""
T = TypeVar("T")
P = ParamSpec("P")


def guard(job: Callable[..., T], *arguments: Any) -> tuple[T | None, BaseException | None]:
    """Runs an author's code: its result, or what it raised.

    `SystemExit` and the like are an author's errors too: no component may end its host. A `KeyboardInterrupt` goes
    through only where it may be the operator's: in the main thread, while Python raises it for Ctrl-C. Under
    `asyncio.Runner`, and so in every flight in virtual time, Ctrl-C cancels the main task instead.
    """
    try:
        return job(*arguments), None
    except KeyboardInterrupt as error:
        is_raised_by_python = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if is_raised_by_python and threading.current_thread() is threading.main_thread():
            raise
        return None, error
    except (Exception, SystemExit, GeneratorExit, asyncio.CancelledError) as error:  # noqa: BLE001
        return None, error


def rate_priority(rate_hz: float) -> int:
    """The priority of a required component: the higher its rate, the sooner it goes, below the loop.

    It is rate-monotonic scheduling (Liu and Layland, 1973), with a step for each doubling of the rate.
    """
    return 1 + min(REAL_TIME_PRIORITY - 2, floor(log2(max(1.0, rate_hz))))


def take_real_time_priority(priority: int = REAL_TIME_PRIORITY) -> None:
    """Puts the calling thread before all that are not real-time; threads and processes that it makes later are not.

    Args:
        priority: under SCHED_RR, up to that of the loop.

    Raises:
        Refused: the process may not.
    """
    if sys.platform != "linux":
        raise Refused("real-time priority is known on Linux only")
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise Refused(
            f"this process may have no real-time priority: it needs LimitRTPRIO={REAL_TIME_PRIORITY} as a service, or `ulimit -r {REAL_TIME_PRIORITY}`"
        ) from error


class Worker(Protocol):
    """Runs jobs one after the other and reports each in the loop's thread."""

    def run(self, job: Callable[[], T], done: Callable[[T], None], cost_s: float = 0.0) -> None:
        """Runs a job; `done` gets its result.

        Args:
            job: must not raise.
            done: called in the loop's thread.
            cost_s: modelled duration, used in virtual time only; infinite for a job that never ends.
        """

    def abandon(self) -> None:
        """Gives up the job that is stuck and all that wait behind it; their `done` is never called."""


class InlineWorker:
    """Virtual time: a job runs when its turn comes and ends after its modelled cost."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[tuple[Callable[[], Any], Callable[[Any], None], float]] = deque()
        self._is_busy = False
        self._timer: asyncio.TimerHandle | None = None

    def run(self, job: Callable[[], T], done: Callable[[T], None], cost_s: float = 0.0) -> None:
        """Runs the job now or behind those that have not ended; reports it `cost_s` after its begin."""
        if self._is_busy:
            self._waiting.append((job, done, cost_s))
        elif cost_s == 0.0:
            done(job())
        else:
            self._begin(job, done, cost_s)

    def abandon(self) -> None:
        """Forgets the jobs that have not ended."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._waiting.clear()
        self._is_busy = False

    def _begin(self, job: Callable[[], Any], done: Callable[[Any], None], cost_s: float) -> None:
        self._is_busy = True
        if cost_s != float("inf"):  # a job that never ends does nothing that anybody sees
            self._timer = self._loop.call_later(cost_s, self._end, done, job())

    def _end(self, done: Callable[[Any], None], result: Any) -> None:
        self._timer = None
        done(result)
        self._is_busy = False
        while self._waiting and not self._is_busy:
            job, done, cost_s = self._waiting.popleft()
            if cost_s > 0.0:
                self._begin(job, done, cost_s)
            else:
                self._is_busy = True  # what `done` asks for stands behind those that wait already
                done(job())
                self._is_busy = False


class ImmediateExecutor(Executor):
    """Does everything at once, for virtual time, where there are no threads."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> "Future[T]":
        """Does it."""
        done: Future[T] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


class _Lane:
    """The jobs of one thread."""

    def __init__(self) -> None:
        self.jobs: queue.SimpleQueue[tuple[Callable[[], Any], Callable[[Any], None]] | None] = queue.SimpleQueue()
        self.is_abandoned = False


class ThreadWorker:
    """Wall time: a daemon thread that lives until it is abandoned, so that a stuck job cannot keep a process alive."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        name: str,
        make_room: Callable[[], bool] = lambda: False,
        *,
        priority: int = 0,
    ) -> None:
        """Begins without a thread.

        Args:
            loop: where results are reported.
            name: of the thread.
            make_room: called when there is no memory for a thread; whether there may be now.
            priority: real-time priority of the thread, which the process may give; 0 for none.
        """
        self._loop = loop
        self._name, self._make_room, self._priority = name, make_room, priority
        self._lane: _Lane | None = None

    def run(self, job: Callable[[], T], done: Callable[[T], None], cost_s: float = 0.0) -> None:
        """Queues the job for the thread."""
        if self._lane is None:
            self._lane = self._new_lane()
        self._lane.jobs.put((job, done))

    def _new_lane(self) -> _Lane:
        lane = _Lane()
        while True:
            try:
                threading.Thread(target=self._serve, args=(lane,), name=self._name, daemon=True).start()
            except RuntimeError:
                if not self._make_room():
                    raise
            else:
                return lane

    def abandon(self) -> None:
        """Leaves the thread to its fate: it ends after the job that it is in. The next job starts another."""
        if self._lane is not None:
            self._lane.is_abandoned = True
            self._lane.jobs.put(None)
            self._lane = None

    def _serve(self, lane: _Lane) -> None:
        if self._priority:
            take_real_time_priority(self._priority)
        while (work := lane.jobs.get()) is not None and not lane.is_abandoned:
            job, done = work
            result = job()
            try:
                self._loop.call_soon_threadsafe(self._report, lane, done, result)
            except RuntimeError:  # the loop has been closed: nobody waits any more
                return

    def _report(self, lane: _Lane, done: Callable[[Any], None], result: Any) -> None:
        if lane is self._lane:
            done(result)


GaveUp = Callable[[str], None]
"""Called with the reason why a job will never end."""


class _Job(NamedTuple):
    deadline: asyncio.TimerHandle
    gave_up: GaveUp


class JobQueue:
    """Runs an author's methods on a worker; when one of them is stuck, all are abandoned."""

    def __init__(self, loop: asyncio.AbstractEventLoop, worker: Worker, expired: Callable[[str], None]) -> None:
        self._loop = loop
        self._worker = worker
        self._expired = expired
        self.running: Final[dict[int, _Job]] = {}
        """The jobs that have not ended, by number."""
        self._made = 0

    def run(
        self,
        job: Callable[[], T],
        ended: Callable[[T], None],
        gave_up: GaveUp,
        *,
        what: str,
        limit_s: float,
        cost_s: float = 0.0,
    ) -> None:
        """Runs a job.

        Args:
            job: must not raise.
            ended: called with its result, in the loop's thread.
            gave_up: called instead when it, or another before it, did not end in time.
            what: name of the job in the cause of a timeout.
            limit_s: longest time until `ended`, including time in the queue.
            cost_s: modelled duration, in virtual time.
        """
        self._made += 1
        number = self._made
        cause = f"timeout: {what} took over {limit_s:g} s"
        self.running[number] = _Job(self._loop.call_later(limit_s, self._expired, cause), gave_up)
        self._worker.run(job, lambda result: self._end(number, ended, result), cost_s)

    def _end(self, number: int, ended: Callable[[Any], None], result: Any) -> None:
        self.running.pop(number).deadline.cancel()
        ended(result)

    def abandon(self) -> list[GaveUp]:
        """Abandons the jobs under way; returns the callbacks to notify, in order."""
        jobs = list(self.running.values())
        self.running.clear()
        for job in jobs:
            job.deadline.cancel()
        self._worker.abandon()
        return [job.gave_up for job in jobs]
