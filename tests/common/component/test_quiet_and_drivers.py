"""Quiet, and what a driver does to its device before it leaves it."""

import pytest

from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.errors import Refused

from .specimen import Diary, Driver, Specimen, row


def test_quiet_withholds_results_but_no_reply_status_event_or_log() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(log=["factor"]), lambda: Specimen(diary))
        bench.command("specimen", "goquiet")
        bench.envelopes.clear()
        diary.calls.clear()
        bench.run(2.0)
        assert bench.call("specimen", "scale", factor=2.0).is_accepted
        assert not bench.command("specimen", "start").is_accepted
        assert bench.command("specimen", "stop").is_accepted
        assert diary.calls.count("work") == pytest.approx(20, abs=1)
        assert bench.all("result") == []
        found = {envelope.topic.rpartition("/")[2] for envelope in bench.envelopes}
        assert {"status", "internal", "function_reply", "reply", "event"} <= found


def test_a_quiet_component_that_resumes_publishes_in_its_next_cycle() -> None:
    with Bench() as bench:
        bench.host(row(begin="quiet", rate_hz=20.0), lambda: Specimen(Diary()))
        bench.run(1.01)
        began_s = bench.loop.time()
        bench.command("specimen", "resume")
        bench.run(0.05)
        assert len(bench.all("result")) == 1
        assert bench.envelopes[-1].t_s - began_s < 0.05


def test_a_quiet_driver_moves_nothing() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin="quiet"), lambda: Driver(diary))
        bench.run(1.0)
        assert diary.calls.count("work") == pytest.approx(11, abs=1)
        assert diary.writes == []
        bench.command("specimen", "resume")
        bench.run(1.0)
        assert len(diary.writes) == pytest.approx(10, abs=1)


@pytest.mark.parametrize(
    ("command", "calls"),
    [
        ("goquiet", ["check_leaving", "make_safe", "goquiet"]),
        ("stop", ["check_leaving", "make_safe", "stop"]),
        ("shutdown", ["check_leaving", "make_safe", "stop", "finish"]),
    ],
)
def test_a_working_driver_leaves_its_device_safe_first(command: str, calls: list[str]) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.55)
        diary.calls.clear()
        assert bench.command("specimen", command).is_accepted
        assert diary.calls == calls


@pytest.mark.parametrize("command", ["goquiet", "stop", "shutdown"])
def test_a_driver_may_refuse_to_leave_its_device_and_works_on(command: str) -> None:
    diary = Diary()
    diary.errors["check_leaving"] = Refused("in flight, and the autopilot follows us")
    with Bench() as bench:
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.55)
        reply = bench.command("specimen", command)
        assert (reply.is_accepted, reply.reason) == (False, "in flight, and the autopilot follows us")
        assert "make_safe" not in diary.calls
        writes = len(diary.writes)
        bench.run(1.0)
        assert bench.state("specimen") is State.WORKING
        assert len(diary.writes) > writes + 8


def test_a_driver_that_has_not_worked_since_it_was_safe_leaves_its_device_alone() -> None:
    """A standby that comes up, or goes down, must not disturb the primary's device."""
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin="quiet"), lambda: Driver(diary))
        bench.run(0.55)
        bench.command("specimen", "resume", None, "goquiet")
        bench.command("specimen", "stop", None, "start", "goquiet", "stop")
        diary.errors["start"] = ValueError("odd")
        bench.command("specimen", "start")
        assert bench.state("specimen") is State.FAULTY
        assert "make_safe" not in diary.calls
        assert "check_leaving" not in diary.calls


def test_a_quiet_driver_that_turns_faulty_leaves_the_device_alone() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin="quiet"), lambda: Driver(diary))
        diary.errors["work"] = ValueError("odd")
        bench.run(0.5)
        assert diary.calls[-2:] == ["work", "stop"]
        assert "make_safe" not in diary.calls


@pytest.mark.parametrize("method", ["work", "actuate", "nudge", "goquiet", "stop"])
def test_a_working_driver_that_turns_faulty_leaves_its_device_safe_before_anybody_is_told(method: str) -> None:
    diary = Diary()
    safe_when_told: list[bool] = []
    with Bench() as bench:
        bench.exchange.subscribe(
            "bench/components/specimen/status",
            lambda e: safe_when_told.append("make_safe" in diary.calls) if e.payload.state == "faulty" else None,
        )
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.55)
        diary.errors[method] = ValueError("odd")
        bench.call("specimen", "nudge", factor=1.0)
        bench.run(0.1)
        bench.command("specimen", "goquiet")
        bench.command("specimen", "resume")
        bench.command("specimen", "stop")
        bench.run(0.1)
        assert bench.state("specimen") is State.FAULTY
        assert safe_when_told[0]
        assert diary.calls.count("stop") == 1
        writes = len(diary.writes)
        bench.run(1.0)
        assert len(diary.writes) == writes


def test_a_driver_whose_cycle_hangs_is_made_safe_and_stopped_before_anybody_is_told() -> None:
    diary = Diary()
    reported: list[list[str]] = []
    with Bench(cycle_cost_s=lambda name, now_s: float("inf") if now_s >= 1.0 else 0.0) as bench:
        bench.exchange.subscribe("bench/components/specimen/event", lambda e: reported.append(diary.calls[-2:]))
        bench.host(row(), lambda: Driver(diary))
        bench.run(2.0)
        assert reported[-1] == diary.calls[-2:] == ["make_safe", "stop"]


def test_an_error_in_the_question_whether_it_may_leave_is_a_fault_and_the_device_is_left_safe() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.55)
        diary.errors["check_leaving"] = ValueError("odd")
        diary.calls.clear()
        assert bench.command("specimen", "stop").state is State.FAULTY
        assert diary.calls == ["check_leaving", "make_safe", "stop"]


@pytest.mark.parametrize("way_down", ["stop", "goquiet", "fault"])
def test_a_device_that_was_left_safe_is_not_disturbed_again(way_down: str) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.55)
        if way_down == "fault":
            diary.errors["work"] = ValueError("odd")
            bench.run(0.1)
            diary.errors.clear()
            bench.command("specimen", "initialize")
        else:
            bench.command("specimen", way_down)
        assert diary.calls.count("make_safe") == 1
        if way_down == "goquiet":
            bench.command("specimen", "stop")
        bench.command("specimen", "start", None, "goquiet", "stop", "shutdown")
        assert diary.calls.count("make_safe") == 1


def test_an_error_in_make_safe_does_not_hide_the_fault_and_is_counted() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Driver(diary))
        diary.errors["work"] = ValueError("odd")
        diary.errors["make_safe"] = OSError("device gone")
        bench.run(0.5)
        assert bench.last("components/specimen/status").cause == "ValueError: odd"
        assert "make_safe: OSError: device gone" in bench.hosts["specimen"].errors.causes
        assert diary.calls[-1] == "stop"


def test_a_driver_that_cannot_be_made_safe_on_a_command_is_faulty_and_stopped() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.55)
        diary.errors["make_safe"] = OSError("device gone")
        assert bench.command("specimen", "goquiet").state is State.FAULTY
        assert diary.calls.count("stop") == 1
        assert "goquiet" not in diary.calls
