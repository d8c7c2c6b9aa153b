"""Cycles that a device asks for, beside the periodic ones."""

import pytest

from gloc3.component.lci import State
from gloc3.component.test_bench import Bench

from .specimen import Diary, Specimen, row


def times(bench: Bench) -> list[float]:
    """When the results' cycles began."""
    return [envelope.t_s for envelope in bench.envelopes if envelope.topic == "bench/result"]


def specimen(bench: Bench, rate_hz: float) -> Specimen:
    """A component under its host, after its first second."""
    made: list[Specimen] = []

    def create() -> Specimen:
        made.append(Specimen(Diary()))
        return made[-1]

    bench.host(row(rate_hz=rate_hz), create)
    bench.run(1.0)
    bench.envelopes.clear()
    return made[-1]


def test_a_component_without_a_host_may_ask_and_nothing_happens() -> None:
    diary = Diary()
    component = Specimen(diary)
    before = list(diary.calls)
    component.request_cycle()
    assert diary.calls == before


def test_a_request_begins_a_cycle_at_once_and_the_periodic_ones_fill_the_silence_only() -> None:
    with Bench() as bench:
        requesting = specimen(bench, rate_hz=10.0)
        for _ in range(10):
            bench.run(0.06)
            requesting.request_cycle()
            bench.run(0.04)
        assert times(bench) == pytest.approx([1.06 + 0.1 * index for index in range(10)])
        bench.envelopes.clear()
        bench.run(1.0)
        assert times(bench) == pytest.approx([2.11 + 0.1 * index for index in range(9)])


def test_requests_reach_no_more_than_twice_the_rate_and_none_is_lost() -> None:
    with Bench() as bench:
        requesting = specimen(bench, rate_hz=10.0)
        for _ in range(100):
            bench.run(0.01)
            requesting.request_cycle()
        assert len(times(bench)) == pytest.approx(20, abs=1)
        bench.run(0.06)
        assert times(bench)[-1] >= 2.0


@pytest.mark.parametrize("phase_s", [0.0, 0.007, 0.02, 0.03, 0.049])
def test_a_device_that_comes_at_the_rate_sets_the_pace_whatever_its_phase(phase_s: float) -> None:
    with Bench() as bench:
        requesting = specimen(bench, rate_hz=20.0)
        bench.run(phase_s)
        for index in range(80):
            bench.run(0.04 if index % 2 else 0.06)
            requesting.request_cycle()
        assert len([t_s for t_s in times(bench) if t_s > 3.0]) == pytest.approx(40, abs=2)


def test_a_request_while_standing_by_begins_nothing() -> None:
    with Bench() as bench:
        requesting = specimen(bench, rate_hz=10.0)
        bench.command("specimen", "stop")
        bench.envelopes.clear()
        requesting.request_cycle()
        bench.run(1.0)
        assert bench.state("specimen") is State.STANDBY
        assert times(bench) == []


def test_a_request_after_the_end_of_the_process_harms_nobody() -> None:
    with Bench() as bench:
        requesting = specimen(bench, rate_hz=10.0)
    requesting.request_cycle()


def test_the_component_that_takes_the_place_of_a_hung_one_may_ask_too() -> None:
    made: list[Specimen] = []

    def create() -> Specimen:
        made.append(Specimen(Diary()))
        return made[-1]

    with Bench(cycle_cost_s=lambda name, now_s: float("inf") if 1.0 <= now_s < 1.05 else 0.0) as bench:
        bench.host(row(rate_hz=2.0), create)
        bench.run(4.0)
        bench.command("specimen", "initialize", None, "start")
        bench.run(0.4)
        bench.envelopes.clear()
        made[-1].request_cycle()
        bench.run(0.01)
        assert len(times(bench)) == 1
