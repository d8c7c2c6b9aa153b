"""A simulator on a clock that runs on while the computer does something else."""

from collections.abc import Callable
from typing import Any

import pytest

from gloc3_sitl.vehicles.simulator import Simulator
from gloc3_sitl.world import World


class Handle:
    def cancel(self) -> None:
        """Nothing to cancel: the test calls what is due."""


class StallingLoop:
    """A loop whose clock the test sets, and whose timers it runs."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.due: Callable[[], object] = lambda: None

    def time(self) -> float:
        return self.now_s

    def call_at(self, _when: float, callback: Callable[[], object], *_: Any) -> Handle:
        self.due = callback
        return Handle()


@pytest.fixture
def loop() -> StallingLoop:
    return StallingLoop()


def start(loop: StallingLoop, speed: float = 1.0) -> Simulator:
    simulator = Simulator(World.load("hold"))
    simulator.start(loop, speed)  # type: ignore[arg-type] # as much of a loop as it needs
    return simulator


def test_a_short_stall_is_caught_up_with_in_pieces_and_the_clock_does_not_slip(loop: StallingLoop) -> None:
    simulator = start(loop)
    loop.now_s += 1.4
    steps = []
    for _ in range(3):
        before_s = simulator.now_s
        loop.due()
        steps.append(simulator.now_s - before_s)
    assert simulator.now_s == pytest.approx(1.4, abs=0.02)
    assert max(steps) <= 0.5 + 1e-6, "others have their turn in between"
    assert simulator.late == 0


def test_after_a_long_stall_the_clock_slips_and_that_is_counted(loop: StallingLoop) -> None:
    simulator = start(loop)
    loop.now_s += 60.0
    loop.due()
    assert simulator.late == 1
    assert simulator.now_s < 0.1
    loop.now_s += 0.3
    loop.due()
    assert simulator.now_s == pytest.approx(0.32, abs=0.03)


def test_faster_than_real_time_the_same_holds_in_simulated_time(loop: StallingLoop) -> None:
    simulator = start(loop, speed=4.0)
    loop.now_s += 0.4
    loop.due()
    assert simulator.now_s == pytest.approx(1.6, abs=0.03)
    assert simulator.late == 0
