"""Cycles under the host: periodic and triggered, overruns, hanging, rates, inputs."""

from itertools import pairwise

import pytest

from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.messages.envelope import ComponentStatus
from gloc3.messages.topics import TopicRow

from .specimen import Diary, Number, Specimen, row, topics


def status_of(bench: Bench) -> ComponentStatus:
    """The specimen's health as it is now."""
    return bench.hosts["specimen"].status()


def times(bench: Bench) -> list[float]:
    """When the results' cycles began."""
    return [envelope.t_s for envelope in bench.envelopes if envelope.topic == "bench/result"]


def test_periodic_cycles_keep_their_rate_without_drift() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=30.0), lambda: Specimen(Diary()))
        bench.run(60.0)
        assert times(bench) == pytest.approx([index / 30.0 for index in range(1801)], abs=1e-9)
        assert status_of(bench).overruns == 0


def test_in_real_time_the_cycles_of_components_of_one_rate_are_spread_over_the_period() -> None:
    names = [f"sonar_{number}" for number in range(8)]
    with Bench() as bench:
        bench.context = bench.context._replace(is_real_time=True)
        for name in names:
            bench.host(row(name, ports={"result": name}), lambda: Specimen(Diary()))
        bench.run(0.35)
    began = [[each.t_s for each in bench.envelopes if each.topic == f"bench/{name}"] for name in names]
    assert all(
        0.0 <= times[0] < 0.1 and times[1:] == pytest.approx([t_s + 0.1 for t_s in times[:-1]]) for times in began
    )
    first = sorted(times[0] for times in began)
    assert first[-1] - first[0] > 0.05
    assert all(later - sooner > 1e-4 for sooner, later in pairwise(first))


def test_a_cycle_can_be_begun_by_an_inputs_arrival() -> None:
    with Bench(topics=topics()) as bench:
        bench.host(row(rate_hz=None, trigger="given"), lambda: Specimen(Diary()))
        for value in (1.0, 2.0):
            bench.run(0.25)
            bench.send("given", Number(value=value))
        bench.run(1.0)
        assert times(bench) == [0.25, 0.5]
        assert [message.value for message in bench.all("result")] == [1.0, 2.0]


@pytest.mark.parametrize(
    ("rate_hz", "given", "nominal_hz"),
    [
        (None, ["given"], 10.0),  # the topic's
        (4.0, ["given"], 10.0),  # the periodic cycles only fill its silence
        (25.0, ["given"], 25.0),
        (None, ["news"], 0.0),  # speaks when something happens
        (4.0, ["news"], 4.0),
        (None, ["news", "given"], 10.0),
        (None, ["nobody/knows"], 0.0),
    ],
)
def test_the_nominal_rate_of_a_triggered_component_is_that_of_the_topic_that_triggers_it(
    rate_hz: float | None, given: list[str], nominal_hz: float
) -> None:
    table = topics()
    table.add({"news": TopicRow(Number)})
    with Bench(topics=table) as bench:
        bench.host(row(rate_hz=rate_hz, trigger="given", ports={"given": given}), lambda: Specimen(Diary()))
        bench.run(0.1)
        assert status_of(bench).nominal_rate_hz == nominal_hz


def test_messages_that_arrive_together_begin_one_cycle() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(rate_hz=None, trigger="given", ports={"given": ["left", "right"]}), lambda: Specimen(diary))

        def two(_: object) -> None:
            bench._publisher.publish("bench/left", Number(value=1.0), 0.0)
            bench._publisher.publish("bench/right", Number(value=2.0), 0.0)

        bench.exchange.subscribe("bench/go", two)
        bench.send("go", Number(value=0.0))
        bench.run(0.1)
        assert diary.calls.count("work") == 1
        assert bench.last("result").value == 2.0


def test_with_rate_and_trigger_the_periodic_cycles_fill_the_silence_only() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=10.0, trigger="given"), lambda: Specimen(Diary()))
        for _ in range(20):
            bench.run(0.09)
            bench.send("given", Number(value=1.0))
        assert len(times(bench)) == 21
        bench.envelopes.clear()
        bench.run(1.0)
        assert len(times(bench)) == pytest.approx(10, abs=1)


@pytest.mark.parametrize("port", ["given", "every"])
def test_only_messages_on_the_trigger_begin_a_cycle(port: str) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(rate_hz=None, trigger="given"), lambda: Specimen(diary))
        bench.send(port, Number(value=1.0))
        bench.run(0.1)
        assert ("work" in diary.calls) == (port == "given")


def test_overruns_are_counted_and_never_made_up() -> None:
    diary = Diary()
    with Bench(cycle_cost_s=lambda name, now_s: 0.15) as bench:
        bench.host(row(rate_hz=10.0), lambda: Specimen(diary))
        bench.run(10.05)
        status = bench.last("components/specimen/status")
        assert status.cycle_mean_s == pytest.approx(0.15)
        assert status.overruns == pytest.approx(50, abs=1)
        assert status.rate_hz == pytest.approx(5.0, abs=1.0)
        assert diary.calls.count("work") == pytest.approx(50, abs=1)
        assert status.state is State.WORKING


def test_cycles_that_a_late_loop_has_missed_are_overruns_and_not_made_up() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=10.0), lambda: Specimen(Diary()))
        bench.run(1.05)

        def block() -> None:
            bench.loop._now_s += 0.37  # as if a callback had taken so long

        bench.loop.call_soon(block)
        bench.envelopes.clear()
        bench.run(0.3)
        assert times(bench) == pytest.approx([1.42, 1.5, 1.6, 1.7])
        assert status_of(bench).overruns == 3


def test_a_cycle_that_is_under_way_when_cycles_are_stopped_is_forgotten() -> None:
    with Bench(cycle_cost_s=lambda name, now_s: 0.1) as bench:
        bench.host(row(rate_hz=1.0), lambda: Specimen(Diary()))
        bench.run(1.05)
        bench.envelopes.clear()
        bench.hosts["specimen"]._hosted._cycler.stop()
        bench.run(1.0)
        assert times(bench) == []


def test_a_command_under_way_is_no_overrun() -> None:
    with Bench(method_cost_s=lambda name, method, now_s: 0.5 if method == "goquiet" else 0.0) as bench:
        bench.host(row(rate_hz=10.0), lambda: Specimen(Diary()))
        bench.command("specimen", "goquiet")
        assert status_of(bench).overruns == 0


def test_overruns_of_triggered_cycles_are_counted_and_what_came_waits_for_the_next() -> None:
    with Bench(cycle_cost_s=lambda name, now_s: 0.1) as bench:
        bench.host(row(rate_hz=None, trigger="given"), lambda: Specimen(Diary()))
        for value in (1.0, 2.0, 3.0):
            bench.send("given", Number(value=value))
            bench.run(0.06)
        bench.run(1.0)
        assert status_of(bench).overruns == 1
        assert [message.value for message in bench.all("result")] == [1.0, 3.0]


def test_results_of_a_slow_cycle_come_late_with_the_time_of_its_begin() -> None:
    arrivals: list[tuple[float, float]] = []
    with Bench() as bench:
        bench.exchange.subscribe("bench/result", lambda e: arrivals.append((bench.loop.time(), e.t_s)))
        bench.host(row(rate_hz=10.0, latency_s=0.07), lambda: Specimen(Diary()))
        bench.run(0.5)
        assert arrivals[:2] == [pytest.approx((0.07, 0.0)), pytest.approx((0.17, 0.1))]


@pytest.mark.parametrize(("rate_hz", "limit_s"), [(50.0, 0.2), (10.0, 0.5), (1.0, 5.0)])
def test_a_cycle_that_does_not_end_makes_its_component_faulty_while_the_rest_runs_on(
    rate_hz: float, limit_s: float
) -> None:
    diary = Diary()

    def cost_s(name: str, now_s: float) -> float:
        return float("inf") if name == "specimen" and now_s >= 3.0 else 0.0

    with Bench(cycle_cost_s=cost_s) as bench:
        bench.host(row("other", ports={"result": "other"}), lambda: Specimen(Diary()))
        bench.host(row(rate_hz=rate_hz), lambda: Specimen(diary))
        bench.run(3.0 + limit_s - 0.01)
        assert bench.state("specimen") is State.WORKING
        bench.run(0.02)
        status = bench.last("components/specimen/status")
        assert (status.state, status.errors) == (State.FAULTY, 1)
        assert status.cause == f"hung: a cycle had not ended after {limit_s:g} s"
        assert status.cause_last_s == pytest.approx(3.0 + limit_s)
        assert diary.methods()[-1] == "stop"
        bench.run(1.0)
        assert bench.last("other").value == pytest.approx(bench.loop.time(), abs=0.11)


def test_a_slow_cycle_within_the_limit_is_not_hung() -> None:
    with Bench(cycle_cost_s=lambda name, now_s: 0.19) as bench:
        bench.host(row(rate_hz=50.0), lambda: Specimen(Diary()))
        bench.run(5.0)
        assert bench.state("specimen") is State.WORKING


def test_a_triggered_cycle_hangs_by_the_rate_of_its_topic() -> None:
    with Bench(topics=topics(), cycle_cost_s=lambda name, now_s: float("inf")) as bench:
        bench.host(row(rate_hz=None, trigger="given"), lambda: Specimen(Diary()))
        bench.send("given", Number(value=1.0))
        bench.run(1.0)
        assert status_of(bench).cause_first_s == pytest.approx(0.5)


def test_a_hung_component_comes_back_as_a_new_instance() -> None:
    diary = Diary()
    with Bench(cycle_cost_s=lambda name, now_s: float("inf") if 1.0 <= now_s < 1.05 else 0.0) as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.run(2.0)
        diary.calls.clear()
        assert bench.command("specimen", "initialize", None, "start").state is State.WORKING
        bench.run(0.05)
        assert diary.calls == ["finish", "__init__", "initialize", "start", "work"]


def test_who_waits_for_a_hung_component_is_told() -> None:
    with Bench(cycle_cost_s=lambda name, now_s: float("inf") if now_s >= 1.0 else 0.0) as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.run(1.01)
        reply = bench.command("specimen", "stop")
        assert (reply.is_accepted, reply.state) == (False, State.FAULTY)
        assert reply.reason == "stop failed: hung: a cycle had not ended after 0.5 s"
        bench.run(10.0)
        assert status_of(bench).errors == 1


def test_a_command_waits_for_the_cycle_under_way_and_its_results_are_published() -> None:
    diary = Diary()
    with Bench(cycle_cost_s=lambda name, now_s: 0.1) as bench:
        bench.host(row(rate_hz=5.0), lambda: Specimen(diary))
        bench.run(0.45)
        bench.envelopes.clear()
        assert bench.command("specimen", "stop").is_accepted
        assert bench.loop.time() == pytest.approx(0.5)
        assert len(bench.all("result")) == 1


def test_the_rate_can_be_changed_while_working_and_the_rhythm_goes_on_from_the_last_cycle() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=10.0), lambda: Specimen(Diary()))
        bench.run(1.05)
        bench.envelopes.clear()
        reply = bench.call("specimen", "set_rate", rate_hz=4.0)
        assert (reply.is_accepted, reply.result) == (True, {"rate_hz": 4.0})
        bench.run(1.0)
        assert times(bench) == pytest.approx([1.25, 1.5, 1.75, 2.0])
        assert bench.last("components/specimen/status").nominal_rate_hz == 4.0
        assert status_of(bench).overruns == 0


def test_a_changed_rate_outlives_a_stop_and_a_fault() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(rate_hz=10.0), lambda: Specimen(diary))
        bench.call("specimen", "set_rate", rate_hz=20.0)
        diary.errors["work"] = ValueError("odd")
        bench.run(1.0)
        diary.errors.clear()
        bench.command("specimen", "initialize", None, "start")
        assert status_of(bench).nominal_rate_hz == 20.0


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 2000.0, float("nan"), float("inf"), "fast", None])
def test_a_rate_that_makes_no_sense_is_refused(rate_hz: object) -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        reply = bench.call("specimen", "set_rate", rate_hz=rate_hz)
        assert not reply.is_accepted
        assert "rate_hz" in reply.reason
        assert status_of(bench).nominal_rate_hz == 10.0


def test_a_component_that_is_only_triggered_has_no_rate_to_change() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=None, trigger="given"), lambda: Specimen(Diary()))
        reply = bench.call("specimen", "set_rate", rate_hz=5.0)
        assert reply.reason == "it has no rate: its cycles are begun by an input"


def test_what_does_not_fit_a_bounded_queue_is_dropped_and_counted() -> None:
    used: list[float] = []

    class Keeper(Specimen):
        def work(self, now_s, inbox):  # type: ignore[no-untyped-def]
            used.extend(envelope.payload.value for envelope in inbox.new(self.every))
            return []

    with Bench() as bench:
        bench.host(row(rate_hz=1.0), lambda: Keeper(Diary()))
        bench.run(0.5)
        for value in range(7):
            bench.send("every", Number(value=float(value)))
            bench.send("given", Number(value=float(value)))
        bench.run(1.0)
        assert used == [0.0, 1.0, 2.0, 3.0]
        assert status_of(bench).dropped == 3


def test_what_comes_in_while_it_does_not_work_is_no_loss() -> None:
    with Bench() as bench:
        bench.host(row(begin="standby"), lambda: Specimen(Diary()))
        for value in range(9):
            bench.send("every", Number(value=float(value)))
        assert status_of(bench).dropped == 0


def test_the_reported_rate_is_of_the_time_since_the_last_report_and_of_this_start() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=20.0), lambda: Specimen(Diary()))
        bench.run(2.5)
        assert status_of(bench).rate_hz == pytest.approx(20.0, abs=1.0)
        bench.command("specimen", "stop")
        assert status_of(bench).rate_hz == 0.0
        bench.command("specimen", "start")
        assert status_of(bench).rate_hz == 0.0
        bench.run(2.0)
        assert status_of(bench).rate_hz == pytest.approx(20.0, abs=1.0)


def test_what_the_fault_model_costs_is_not_measured_and_the_rest_costs_nothing_in_virtual_time() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.run(3.0)
        assert (status_of(bench).cycle_mean_s, status_of(bench).cycle_max_s) == (0.0, 0.0)


def test_several_inputs_can_begin_cycles() -> None:
    with Bench() as bench:
        bench.host(row(rate_hz=None, trigger=["given", "every"]), lambda: Specimen(Diary()))
        for port in ("given", "every", "given"):
            bench.run(0.25)
            bench.send(port, Number(value=1.0))
        bench.run(0.1)
        assert list(dict.fromkeys(times(bench))) == [0.25, 0.5, 0.75]
