"""What a host has under way on its component's worker, each errand with a time limit."""

import asyncio
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from gloc3.component.workers import Worker

T = TypeVar("T")

GaveUp = Callable[[str], None]
"""Is told why an errand will never end."""


class _Errand(NamedTuple):
    deadline: asyncio.TimerHandle
    gave_up: GaveUp


class Errands:
    """Runs an author's methods on a worker; when one of them sticks, all are given up."""

    def __init__(self, loop: asyncio.AbstractEventLoop, worker: Worker, expired: Callable[[str], None]) -> None:
        self._loop = loop
        self._worker = worker
        self._expired = expired
        self._under_way: dict[int, _Errand] = {}
        self._made = 0

    def __len__(self) -> int:
        """How many have not ended."""
        return len(self._under_way)

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
            ended: gets its result, in the loop's thread.
            gave_up: called instead when it, or another before it, did not end in time.
            what: names it in the cause of a time-out.
            limit_s: longest time until `ended`, what it waits for included.
            cost_s: modelled duration, in virtual time.
        """
        self._made += 1
        number = self._made
        cause = f"timeout: {what} took over {limit_s:g} s"
        self._under_way[number] = _Errand(self._loop.call_later(limit_s, self._expired, cause), gave_up)
        self._worker.run(job, lambda result: self._end(number, ended, result), cost_s)

    def _end(self, number: int, ended: Callable[[Any], None], result: Any) -> None:
        self._under_way.pop(number).deadline.cancel()
        ended(result)

    def abandon(self) -> list[GaveUp]:
        """Leaves what is under way to its fate; returns who has to be told, in order."""
        errands = list(self._under_way.values())
        self._under_way.clear()
        for errand in errands:
            errand.deadline.cancel()
        self._worker.abandon()
        return [errand.gave_up for errand in errands]
