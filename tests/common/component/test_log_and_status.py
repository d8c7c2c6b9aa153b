"""The data logger and the status notifier under the host."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from gloc3.component.component import SensorSampler
from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.component.test_bench import Bench
from gloc3.messages.envelope import ComponentStatus, Severity
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.messages.vehicle import HeightAboveGround

from .specimen import Diary, Specimen, row


def logged(bench: Bench) -> list[dict[str, Any]]:
    """What was recorded so far."""
    return [message.items for message in bench.all("components/specimen/internal")]


def test_selected_items_are_recorded_at_the_end_of_every_cycle() -> None:
    with Bench() as bench:
        bench.host(row(log=["cycles", "table"]), lambda: Specimen(Diary()))
        bench.run(0.25)
        assert logged(bench) == [{"cycles": cycle, "table": {"1": (1.0, 2.0)}} for cycle in (1, 2, 3)]


def test_nothing_is_recorded_where_nothing_is_selected() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.run(0.25)
        assert logged(bench) == []


def test_what_is_recorded_and_whether_can_be_changed_while_working() -> None:
    with Bench() as bench:
        bench.host(row(log=["cycles"]), lambda: Specimen(Diary()))
        assert bench.call("specimen", "set_logging", items=["factor", "factor"]).result == {"items": ["factor"]}
        bench.run(0.15)
        assert logged(bench)[-1] == {"factor": 1.0}
        assert bench.call("specimen", "set_logging", is_enabled=False).result == {"items": []}
        bench.envelopes.clear()
        bench.run(0.5)
        assert logged(bench) == []
        assert bench.call("specimen", "set_logging").result == {"items": ["factor"]}
        bench.run(0.5)
        assert len(logged(bench)) == 5


def test_an_item_that_cannot_be_read_is_recorded_as_nothing_and_harms_nobody() -> None:
    with Bench() as bench:
        bench.host(row(log=["factor", "broken"]), lambda: Specimen(Diary()))
        bench.run(1.0)
        assert logged(bench)[-1] == {"factor": 1.0, "broken": None}
        status = bench.last("components/specimen/status")
        assert (status.state, status.cause) == (State.WORKING, "log item broken: ValueError: nothing to see here")
        warnings = [e for e in bench.all("components/specimen/event") if e.severity is Severity.WARNING]
        assert len(warnings) == 1
        assert status.errors == status.cycles


def test_the_record_is_a_snapshot_of_plain_data() -> None:
    class Rich(Specimen):
        loggable = ("history", "array", "single", "thing")

        def __init__(self, diary: Diary) -> None:
            super().__init__(diary)
            self.history: list[float] = []

        @property
        def array(self) -> Any:
            return np.eye(2)

        @property
        def single(self) -> Any:
            return np.float32(0.5)

        @property
        def thing(self) -> Any:
            return object()

        def work(self, now_s: float, inbox: Any) -> Any:
            self.history.append(now_s)
            return []

    with Bench() as bench:
        bench.host(row(log=["history", "array", "single", "thing"]), lambda: Rich(Diary()))
        bench.run(0.15)
        first = logged(bench)[0]
        assert first["history"] == [0.0]
        assert (first["array"], first["single"]) == ([[1.0, 0.0], [0.0, 1.0]], 0.5)
        assert first["thing"] == "<object object>"


def test_status_comes_at_the_set_period_and_on_every_change() -> None:
    reported: list[tuple[float, ComponentStatus]] = []
    with Bench() as bench:
        bench.exchange.subscribe(
            "bench/components/specimen/status", lambda e: reported.append((bench.loop.time(), e.payload))
        )
        bench.host(row(status_period_s=0.5), lambda: Specimen(Diary()))
        assert [status.state for _, status in reported] == [State.IDLE, State.STANDBY, State.WORKING]
        bench.run(1.2)
        bench.command("specimen", "goquiet")
        bench.run(0.5)
        assert [round(t_s, 6) for t_s, _ in reported[3:]] == [0.5, 1.0, 1.2, 1.5]
        assert reported[-1][1].state is State.QUIET


def test_a_changed_rate_is_told_at_once() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.call("specimen", "set_rate", rate_hz=5.0)
        assert bench.last("components/specimen/status").nominal_rate_hz == 5.0


def test_status_says_what_the_row_says() -> None:
    with Bench() as bench:
        bench.host(row(required=True, standby_for="other", begin="quiet"), lambda: Specimen(Diary()))
        status = bench.last("components/specimen/status")
        assert (status.name, status.kind, status.is_required, status.standby_for) == ("specimen", "DP", True, "other")
        assert (status.nominal_rate_hz, status.state) == (10.0, State.QUIET)


class Speaker(SensorSampler[NoSettings]):
    """Speaks while it has something to say."""

    height = Output(HeightAboveGround)

    def __init__(self) -> None:
        self.has_words = True

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        return [HeightAboveGround(height_m=1.0, is_valid=True)] if self.has_words else []


@pytest.mark.parametrize(("topic", "silent_s"), [("height", 0.5), ("slow", 10.0), ("now_and_then", None)])
def test_status_names_the_topics_on_which_a_working_component_has_fallen_silent(
    topic: str, silent_s: float | None
) -> None:
    rows = {"height": 20.0, "slow": 50.0, "now_and_then": 0.0}
    topics = TopicTable({name: TopicRow(HeightAboveGround, rate_hz) for name, rate_hz in rows.items()})
    rate_hz = 1.0 if topic == "slow" else 20.0
    line = ComponentRow(
        name="speaker", class_name="x:Speaker", rate_hz=rate_hz, ports={"height": topic}, status_period_s=0.1
    )
    with Bench(topics=topics) as bench:
        speaker = Speaker()
        bench.host(line, lambda: speaker)

        def silent() -> list[str]:
            return list(bench.last("components/speaker/status").silent)

        bench.run(15.0)
        assert silent() == []
        speaker.has_words = False
        bench.run(0.8 * silent_s if silent_s else 60.0)
        assert silent() == []
        if silent_s:
            bench.run(0.4 * silent_s + 0.2)
            assert silent() == [topic]
            bench.command("speaker", "goquiet")
            assert silent() == [], "who is told to be quiet is not silent by itself"
            bench.command("speaker", "resume")
            speaker.has_words = True
            bench.run(2.0)
            assert silent() == []


def test_every_transition_is_told_as_an_event() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.command("specimen", "goquiet")
        bench.command("specimen", "shutdown")
        assert [event.text for event in bench.all("components/specimen/event")] == [
            "initialize: idle -> standby",
            "start: standby -> working",
            "goquiet: working -> quiet",
            "shutdown: quiet -> absent",
        ]


@pytest.mark.parametrize("seed", [1, 2])
def test_the_same_run_is_the_same_to_the_byte(seed: int) -> None:
    def run() -> list[Any]:
        with Bench(seed=seed, cycle_cost_s=lambda name, now_s: 0.01) as bench:
            diary = Diary()
            bench.host(row(log=["cycles"]), lambda: Specimen(diary))
            bench.run(3.0)
            diary.errors["work"] = ValueError(object())
            bench.run(1.0)
            return bench.envelopes

    assert repr(run()) == repr(run())


def test_what_a_component_reports_of_itself_is_in_its_status() -> None:
    class Warm(Specimen):
        status_values = {"temperature": 41.5}

    with Bench() as bench:
        bench.host(row(), lambda: Warm(Diary()))
        bench.run(1.5)
        assert bench.all("components/specimen/status")[-1].values == {"temperature": 41.5}
