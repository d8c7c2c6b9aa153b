"""Workers: where a component's methods run, so that none of them delays the control path.

In wall time each component has a thread of its own. In virtual time its methods run at once, in the loop's thread,
and what a cycle costs is what a model says.
"""

import asyncio
import queue
import threading
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


def guard(job: Callable[[], T]) -> tuple[T | None, Exception | None]:
    """Runs an author's code for its host: the result, or what it raised. The one broad handler of the project."""
    try:
        return job(), None
    except Exception as error:  # noqa: BLE001
        return None, error


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
    """Virtual time: a job runs at once and ends after its modelled cost."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._timers: list[asyncio.TimerHandle] = []

    def run(self, job: Callable[[], T], done: Callable[[T], None], cost_s: float = 0.0) -> None:
        """Runs the job now; reports it now, or `cost_s` later."""
        result = job()
        if cost_s == 0.0:
            done(result)
        elif cost_s != float("inf"):
            self._timers = [timer for timer in self._timers if timer.when() > self._loop.time()]
            self._timers.append(self._loop.call_later(cost_s, done, result))

    def abandon(self) -> None:
        """Forgets the jobs that have not ended."""
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()


class ThreadWorker:
    """Wall time: a daemon thread that lives until it is abandoned, so that a stuck job cannot keep a process alive."""

    def __init__(self, loop: asyncio.AbstractEventLoop, name: str) -> None:
        self._loop = loop
        self._name = name
        self._jobs: queue.SimpleQueue[tuple[Callable[[], Any], Callable[[Any], None]] | None] | None = None

    def run(self, job: Callable[[], T], done: Callable[[T], None], cost_s: float = 0.0) -> None:  # noqa: ARG002
        """Queues the job for the thread."""
        if self._jobs is None:
            self._jobs = queue.SimpleQueue()
            threading.Thread(target=self._serve, args=(self._jobs,), name=self._name, daemon=True).start()
        self._jobs.put((job, done))

    def abandon(self) -> None:
        """Leaves the thread to its fate; the next job starts another."""
        if self._jobs is not None:
            self._jobs.put(None)
            self._jobs = None

    def _serve(self, jobs: "queue.SimpleQueue[tuple[Callable[[], Any], Callable[[Any], None]] | None]") -> None:
        while (work := jobs.get()) is not None:
            job, done = work
            result = job()
            try:
                self._loop.call_soon_threadsafe(self._report, jobs, done, result)
            except RuntimeError:  # the loop has been closed: nobody waits any more
                return

    def _report(self, jobs: Any, done: Callable[[Any], None], result: Any) -> None:
        if jobs is self._jobs:
            done(result)
