"""Virtual time: it jumps, in a fixed order, and hides no error."""

import asyncio
import time
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.clock import VIRTUAL_EPOCH_S, Clock, VirtualLoop, run_virtual
from gloc3.errors import Misuse


def test_virtual_time_starts_at_zero_and_jumps() -> None:
    async def main() -> float:
        assert asyncio.get_running_loop().time() == 0.0
        await asyncio.sleep(3600.0)
        return asyncio.get_running_loop().time()

    began_s = time.perf_counter()
    assert run_virtual(main()) == 3600.0
    assert time.perf_counter() - began_s < 20.0


def test_the_clock_of_a_virtual_loop_has_a_fixed_utc() -> None:
    async def main() -> None:
        clock = Clock(asyncio.get_running_loop())
        assert clock.is_virtual
        assert clock.utc_offset_s == VIRTUAL_EPOCH_S
        await asyncio.sleep(1.5)
        assert clock.now_s() == 1.5

    run_virtual(main())


def test_pictures_get_no_utc_while_the_clock_may_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = asyncio.new_event_loop()
    clock = Clock(loop)
    for is_right in (True, False):
        monkeypatch.setattr(Clock, "is_utc_right", lambda _, is_right=is_right: is_right)
        offset_s = clock.utc_offset()
        assert (offset_s is not None) == is_right
        if offset_s is not None:
            assert offset_s + loop.time() == pytest.approx(time.time(), abs=1.0)
    loop.close()
    virtual = VirtualLoop()
    assert Clock(virtual).utc_offset() == VIRTUAL_EPOCH_S
    virtual.close()


def test_the_clock_of_a_real_loop_is_the_loops_time() -> None:
    async def main() -> None:
        clock = Clock(asyncio.get_running_loop())
        assert not clock.is_virtual
        assert clock.now_s() + clock.utc_offset_s == pytest.approx(time.time(), abs=1.0)

    asyncio.run(main())


@settings(max_examples=50)
@given(st.lists(st.integers(0, 5), min_size=1, max_size=30))
def test_timers_run_in_order_of_time_and_at_one_moment_in_the_order_in_which_they_were_made(whens: list[int]) -> None:
    ran: list[tuple[int, int]] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        for number, when in enumerate(whens):
            loop.call_at(when, ran.append, (when, number))
        await asyncio.sleep(10.0)

    run_virtual(main())
    assert ran == sorted((when, number) for number, when in enumerate(whens))


def test_cancelled_timers_do_not_run_and_do_not_move_the_clock() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        timer = loop.call_at(5.0, lambda: pytest.fail("cancelled"))
        timer.cancel()
        await asyncio.sleep(1.0)
        assert loop.time() == 1.0

    run_virtual(main())


def test_a_timer_in_the_past_runs_at_once() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(2.0)
        called = asyncio.Event()
        loop.call_at(1.0, called.set)
        await called.wait()
        assert loop.time() == 2.0

    run_virtual(main())


def test_what_is_ready_goes_before_what_is_due_and_time_stands_still_meanwhile() -> None:
    order: list[Any] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def due() -> None:
            order.append("timer")
            loop.call_soon(order.append, "after the timer")

        loop.call_later(0.0, due)
        loop.call_soon(order.append, "soon")
        await asyncio.sleep(0.1)
        assert loop.time() == 0.1

    run_virtual(main())
    assert order == ["soon", "timer", "after the timer"]


def test_waiting_for_what_never_comes_is_an_error_and_no_hang() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(Misuse, match="virtual time is stuck"):
        run_virtual(main())


def test_what_a_callback_raises_ends_nothing_but_is_raised_at_the_end() -> None:
    reached: list[float] = []

    def fail() -> None:
        raise ValueError("odd")

    async def main() -> None:
        asyncio.get_running_loop().call_later(1.0, fail)
        await asyncio.sleep(2.0)
        reached.append(2.0)

    with pytest.raises(ValueError, match="odd"):
        run_virtual(main())
    assert reached == [2.0]


def test_an_executor_runs_its_function_at_once_and_hands_its_error_on() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert await loop.run_in_executor(None, lambda: loop.time() + 1.0) == 1.0
        with pytest.raises(ZeroDivisionError):
            await loop.run_in_executor(None, lambda: 1 / 0)

    run_virtual(main())


def test_time_outs_of_asyncio_work_in_virtual_time() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(30.0):
                await asyncio.Event().wait()
        assert loop.time() == 30.0
        loop.call_soon_threadsafe(lambda: None)
        queue: asyncio.Queue[int] = asyncio.Queue()
        loop.call_later(5.0, queue.put_nowait, 7)
        assert await queue.get() == 7
        assert loop.time() == 35.0

    run_virtual(main())


def test_a_closed_loop_takes_no_timers() -> None:
    loop = VirtualLoop()
    loop.close()
    with pytest.raises(RuntimeError):
        loop.call_later(1.0, lambda: None)
