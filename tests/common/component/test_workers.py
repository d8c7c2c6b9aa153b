"""Workers: one job after the other, in virtual time as on a thread."""

import asyncio
import threading
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.clock import run_virtual
from gloc3.component.workers import InlineWorker, JobQueue, ThreadWorker, guard


@settings(max_examples=60)
@given(st.lists(st.tuples(st.sampled_from([0.0, 0.1, 0.25]), st.sampled_from([0.0, 0.1, 0.4])), max_size=12))
def test_inline_jobs_run_one_after_the_other_and_end_after_their_cost(jobs: list[tuple[float, float]]) -> None:
    ended: list[tuple[int, float]] = []
    expected: list[tuple[int, float]] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        worker = InlineWorker(loop)
        free_s = 0.0
        for number, (pause_s, cost_s) in enumerate(jobs):
            if pause_s:
                await asyncio.sleep(pause_s)
            free_s = max(free_s, loop.time()) + cost_s
            expected.append((number, pytest.approx(free_s)))  # type: ignore[arg-type]
            worker.run(lambda number=number: number, lambda n: ended.append((n, loop.time())), cost_s)  # type: ignore[misc]
        await asyncio.sleep(10.0)

    run_virtual(main())
    assert ended == expected


def test_a_job_that_never_ends_never_begins_and_holds_up_those_behind_it_until_it_is_abandoned() -> None:
    ran: list[str] = []

    async def main() -> None:
        worker = InlineWorker(asyncio.get_running_loop())
        worker.run(lambda: ran.append("stuck"), lambda _: ran.append("stuck ended"), float("inf"))
        worker.run(lambda: ran.append("behind"), lambda _: ran.append("behind ended"))
        await asyncio.sleep(100.0)
        assert ran == []
        worker.abandon()
        worker.run(lambda: ran.append("next"), lambda _: ran.append("next ended"), 1.0)
        await asyncio.sleep(2.0)
        assert ran == ["next", "next ended"]

    run_virtual(main())


def test_what_the_end_of_a_job_asks_for_stands_behind_what_waits_already() -> None:
    ran: list[str] = []

    async def main() -> None:
        worker = InlineWorker(asyncio.get_running_loop())

        def first_ended(_: None) -> None:
            worker.run(lambda: ran.append("third"), lambda _: None)

        worker.run(lambda: ran.append("first"), first_ended, 1.0)
        worker.run(lambda: ran.append("second"), lambda _: None)
        await asyncio.sleep(2.0)

    run_virtual(main())
    assert ran == ["first", "second", "third"]


def test_an_abandoned_thread_ends_after_its_job_and_does_not_begin_those_behind_it() -> None:
    async def main() -> None:
        release, began = threading.Event(), threading.Event()
        ran: list[str] = []
        worker = ThreadWorker(asyncio.get_running_loop(), "stuck")

        def stick() -> None:
            began.set()
            release.wait()

        worker.run(stick, lambda _: ran.append("stuck ended"))
        worker.run(lambda: ran.append("behind"), lambda _: ran.append("behind ended"))
        assert began.wait(60.0)
        thread = next(thread for thread in threading.enumerate() if thread.name == "stuck")
        worker.abandon()
        done = asyncio.Event()
        worker.run(lambda: ran.append("next"), lambda _: done.set())
        async with asyncio.timeout(60.0):
            await done.wait()
        release.set()
        thread.join(5.0)
        assert not thread.is_alive()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert ran == ["next"]
        worker.abandon()

    asyncio.run(main())


def test_a_thread_ends_when_nobody_listens_any_more() -> None:
    release = threading.Event()

    async def main() -> threading.Thread:
        ThreadWorker(asyncio.get_running_loop(), "orphan").run(release.wait, lambda _: None)
        return next(thread for thread in threading.enumerate() if thread.name == "orphan")

    thread = asyncio.run(main())
    release.set()
    thread.join(5.0)
    assert not thread.is_alive()


def test_an_errand_that_takes_too_long_is_told_and_all_that_wait_can_be_given_up() -> None:
    reported: list[str] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def expired(cause: str) -> None:
            for gave_up in queued.abandon():
                gave_up(cause)

        queued = JobQueue(loop, InlineWorker(loop), expired)
        queued.run(lambda: "1", reported.append, reported.append, what="first", limit_s=1.0, cost_s=0.5)
        queued.run(lambda: "2", reported.append, reported.append, what="second", limit_s=1.0, cost_s=9.0)
        queued.run(lambda: "3", reported.append, reported.append, what="third", limit_s=5.0)
        assert len(queued.running) == 3
        await asyncio.sleep(20.0)
        assert len(queued.running) == 0

    run_virtual(main())
    assert reported == ["1", "timeout: second took over 1 s", "timeout: second took over 1 s"]


@pytest.mark.parametrize("error", [ValueError(), SystemExit(), GeneratorExit(), asyncio.CancelledError()])
def test_the_guard_holds_what_other_peoples_code_raises(error: BaseException) -> None:
    def fail(*_: Any) -> None:
        raise error

    assert guard(fail, 1, 2) == (None, error)
    assert guard(max, 1, 2) == (2, None)


def test_the_guard_lets_the_operators_interrupt_through() -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        guard(interrupt)
