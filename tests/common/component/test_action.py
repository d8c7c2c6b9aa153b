"""Performing actions: one at a time, answered at once, reported on every change and once a second."""

from collections.abc import Sequence
from typing import Any, ClassVar

import msgspec
import pytest

from gloc3.component.action import ActionPerformer
from gloc3.component.component import Controller
from gloc3.component.deployment import ComponentRow
from gloc3.component.ports import Inbox, Result
from gloc3.component.settings import NoSettings
from gloc3.component.test_bench import Bench
from gloc3.errors import Refused
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.states import ActionState


class Count(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Count up to a number, one a cycle."""

    to: int


class Counter(ActionPerformer, Controller[NoSettings]):
    """Counts; -1 cannot be counted to."""

    performs: ClassVar = {"count": Count}

    def __init__(self) -> None:
        self.diary: list[str] = []
        self.dozen = 0
        """So many counted are an achievement."""
        self._at, self._to = 0, 1

    def begin_action(self, capability: str, arguments: Count, now_s: float) -> None:
        if arguments.to < 0:
            raise Refused("one cannot count to less than nothing")
        self._at, self._to = round(self.earlier_progress * arguments.to), arguments.to

    def pause_action(self, now_s: float) -> None:
        self.diary.append("pause")

    def resume_action(self, now_s: float) -> None:
        self.diary.append("resume")

    def end_action(self, now_s: float) -> None:
        self.diary.append("end")

    def stop(self) -> None:
        self.drop_action()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        if self.is_running:
            self._at += 1
            state = ActionState.DONE if self._at >= self._to else ActionState.RUNNING
            achieved = self._at // self.dozen if self.dozen else None
            self.advance(now_s, self._at / self._to, state, achieved=achieved)
        return self.action_reports(now_s)


class Rig:
    """A counter on a bench."""

    def __init__(self, bench: Bench) -> None:
        self.counter = Counter()
        self.bench = bench
        bench.host(ComponentRow(name="counter", class_name="test:Counter", rate_hz=10.0), lambda: self.counter)

    def request(self, verb: str, action_id: str = "a", **more: Any) -> str:
        """Empty where it is accepted, else the reason."""
        reply = self.bench.call("counter", f"action.{verb}", action_id=action_id, **more)
        assert reply.is_accepted != bool(reply.reason)
        return reply.reason

    def start(self, to: int, action_id: str = "a", **more: Any) -> str:
        return self.request("start", action_id, capability="count", arguments={"to": to}, **more)

    @property
    def reports(self) -> list[ActionStatus]:
        return self.bench.all("action_status")


def test_an_action_runs_to_its_end_and_is_reported_on_change_and_once_a_second() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        assert rig.start(25) == ""
        bench.run(4.0)
        assert [report.state for report in rig.reports] == ["running", "running", "running", "done"]
        assert rig.reports[-1].progress == 1.0
        assert rig.counter.diary == ["end"]


def test_what_is_achieved_is_reported_at_once() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        rig.counter.dozen = 3
        rig.start(8)
        bench.run(1.5)
        assert [report.achieved for report in rig.reports] == [0, 1, 2, 2]
        assert [report.progress for report in rig.reports][1:3] == [3 / 8, 6 / 8]


def test_one_action_at_a_time() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        rig.start(50)
        assert rig.start(5, "b") == "it is busy with action a"
        assert rig.request("cancel") == ""
        assert rig.start(5, "b") == ""


def test_what_cannot_be_done_is_refused_and_nothing_changes() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        assert rig.start(-1) == "one cannot count to less than nothing"
        assert "performs: count" in rig.request("start", capability="sing", arguments={})
        assert "`int`" in rig.request("start", capability="count", arguments={"to": "ten"})
        assert "unknown field" in rig.request("start", capability="count", arguments={"to": 1, "by": 2})
        for verb in ("pause", "resume", "cancel"):
            assert rig.request(verb) == "it does not know action a"
        bench.run(1.0)
        assert rig.reports == []


def test_pause_and_resume_keep_what_was_achieved() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        rig.start(20)
        bench.run(0.55)
        assert rig.request("resume") == "action a is running"
        assert rig.request("pause") == ""
        assert rig.request("pause") == "action a is paused"
        bench.run(3.0)
        paused = rig.reports[-1]
        assert paused.state == "paused"
        assert paused.progress == pytest.approx(0.3, abs=0.06)
        assert rig.request("resume") == ""
        bench.run(2.0)
        assert rig.reports[-1].state == "done"
        assert rig.counter.diary == ["pause", "resume", "end"]


@pytest.mark.parametrize("is_paused", [False, True])
def test_a_cancelled_action_ends_once_and_is_aborted(is_paused: bool) -> None:
    with Bench() as bench:
        rig = Rig(bench)
        rig.start(50)
        if is_paused:
            rig.request("pause")
        rig.request("cancel")
        assert rig.request("cancel") == "action a is aborted"
        bench.run(3.0)
        assert (rig.reports[-1].state, rig.reports[-1].reason) == ("aborted", "cancelled")
        assert rig.counter.diary.count("end") == 1


def test_after_a_restart_in_flight_it_may_go_on_where_it_was() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        rig.start(10, progress=0.8)
        bench.run(0.25)
        assert rig.reports[-1].state == "done"


def test_a_stop_forgets_the_action_without_a_word() -> None:
    with Bench() as bench:
        rig = Rig(bench)
        rig.start(50)
        bench.run(0.2)
        bench.command("counter", "stop")
        bench.command("counter", "start")
        count = len(rig.reports)
        bench.run(2.0)
        assert len(rig.reports) == count
        assert rig.start(5, "b") == ""
