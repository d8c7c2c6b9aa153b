"""Commands under the host: refusals, busy, time-outs, sequences, settings, creation anew."""

from typing import Any

import pytest

from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.errors import InputError, Refused
from gloc3.messages.envelope import CommandReply, CommandRequest, ComponentStatus, Severity

from .specimen import Diary, Number, Specimen, row


class Unspeakable:
    """What cannot be told."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


def request(bench: Bench, command: str, *then: str, request_id: str = "x", **entries: Any) -> None:
    """Sends a command without waiting for the reply."""
    bench.send(
        "components/specimen/command", CommandRequest(request_id=request_id, command=command, then=then, **entries)
    )


def replies(bench: Bench) -> dict[str, CommandReply]:
    """The replies so far, by request."""
    return {reply.request_id: reply for reply in bench.all("components/specimen/reply")}


@pytest.mark.parametrize("begin", ["idle", "standby", "working", "quiet"])
def test_a_row_says_in_which_state_a_component_begins(begin: str) -> None:
    with Bench() as bench:
        bench.host(row(begin=begin), lambda: Specimen(Diary()))
        assert bench.state("specimen") == begin


def test_there_is_no_cycle_and_no_result_between_start_and_goquiet_at_the_begin() -> None:
    diary = Diary()
    with Bench(method_cost_s=lambda *_: 0.5) as bench:
        bench.host(row(begin="quiet", rate_hz=100.0), lambda: Specimen(diary))
        bench.run(3.0)
        assert diary.calls[:5] == ["__init__", "initialize", "start", "goquiet", "work"]
        assert bench.all("result") == []


def test_a_begin_that_is_refused_is_told_and_leaves_the_state_that_was_reached() -> None:
    diary = Diary()
    diary.errors["start"] = Refused("the door is open")
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        assert bench.state("specimen") is State.STANDBY
        event = bench.last("components/specimen/event")
        assert event.severity is Severity.ERROR
        assert event.text == "it did not become working: the door is open"


def test_a_word_that_is_no_command_is_refused_with_the_nearest() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        reply = bench.command("specimen", "stopp")
        assert (reply.is_accepted, reply.state) == (False, State.WORKING)
        assert reply.reason == "'stopp' is no command; did you mean 'stop'?"


def test_a_refusal_changes_nothing() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.run(0.55)
        bench.envelopes.clear()
        before = list(diary.calls)
        for command in ("start", "resume", "finish", "initialize", "nonsense", "create"):
            assert not bench.command("specimen", command).is_accepted
        assert diary.calls == before
        assert bench.state("specimen") is State.WORKING
        topics = {envelope.topic for envelope in bench.envelopes}
        assert topics == {"bench/components/specimen/command", "bench/components/specimen/reply"}


def test_a_component_can_refuse_a_command_itself() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        diary.errors["stop"] = Refused("not now")
        reply = bench.command("specimen", "stop")
        assert (reply.is_accepted, reply.reason, reply.state) == (False, "not now", State.WORKING)
        assert bench.hosts["specimen"].errors.total == 0
        bench.run(1.0)
        assert diary.calls[-1] == "work"


@pytest.mark.parametrize("reason", [(), (Unspeakable(),)])
def test_a_refusal_without_words_is_a_refusal(reason: tuple[object, ...]) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        diary.errors["stop"] = diary.errors["scale"] = Refused(*reason)
        for reply in (bench.command("specimen", "stop"), bench.call("specimen", "scale", factor=1.0)):
            assert (reply.is_accepted, reply.reason) == (False, "refused")
        diary.errors.clear()
        assert bench.command("specimen", "stop").is_accepted


def test_a_refusal_after_something_has_been_changed_is_a_fault() -> None:
    diary = Diary()
    diary.errors["finish"] = Refused("too late")
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        reply = bench.command("specimen", "shutdown")
        assert not reply.is_accepted
        assert bench.state("specimen") is State.FAULTY
        assert diary.methods()[-2:] == ["stop", "finish"]


def test_until_the_reply_other_commands_are_refused_as_busy() -> None:
    diary = Diary()
    with Bench(method_cost_s=lambda name, method, now_s: 2.0 if method == "stop" else 0.0) as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.run(0.5)
        request(bench, "stop", request_id="first")
        bench.run(1.0)
        reply = bench.command("specimen", "goquiet")
        assert (reply.is_accepted, reply.state) == (False, State.WORKING)
        assert reply.reason == "busy: goquiet is not accepted while another command is carried out"
        assert not bench.call("specimen", "scale", factor=2.0).is_accepted
        assert "first" not in replies(bench)
        bench.run(1.5)
        assert replies(bench)["first"].state is State.STANDBY
        assert bench.command("specimen", "start").is_accepted


def test_no_cycle_begins_while_a_command_is_carried_out() -> None:
    diary = Diary()
    with Bench(method_cost_s=lambda name, method, now_s: 2.0 if method == "goquiet" else 0.0) as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.run(0.5)
        diary.calls.clear()
        request(bench, "goquiet")
        bench.run(1.9)
        assert diary.calls == ["goquiet"]
        bench.run(0.3)
        assert diary.calls[1:] == ["work", "work"]


@pytest.mark.parametrize(
    ("command", "before", "methods"),
    [
        ("initialize", [], ["initialize"]),
        ("start", ["initialize"], ["start", "stop"]),
        ("finish", ["initialize"], ["finish"]),
        ("stop", ["initialize", "start"], ["stop"]),
        ("stop", ["initialize", "start", "goquiet"], ["stop"]),
    ],
)
def test_a_command_that_takes_too_long_makes_the_component_faulty(
    command: str, before: list[str], methods: list[str]
) -> None:
    stuck = ""
    diary = Diary()
    with Bench(method_cost_s=lambda name, method, now_s: 5.1 if method == stuck else 0.0) as bench:
        bench.host(row(begin="idle"), lambda: Specimen(diary))
        for step in before:
            bench.command("specimen", step)
        diary.calls.clear()
        stuck = command
        began_s = bench.loop.time()
        reply = bench.command("specimen", command)
        assert bench.loop.time() == pytest.approx(began_s + 5.0)
        assert (reply.is_accepted, reply.state) == (False, State.FAULTY)
        assert reply.reason == f"{command} failed: timeout: {command} took over 5 s"
        assert bench.last("components/specimen/status").cause == f"timeout: {command} took over 5 s"
        assert diary.methods() == methods  # stop() once, and not again because it was late
        bench.run(10.0)
        assert bench.state("specimen") is State.FAULTY


def test_after_a_time_out_the_component_is_made_anew_when_it_is_initialized() -> None:
    is_slow = True
    diary = Diary()
    cost = {"stop": 5.1}
    with Bench(method_cost_s=lambda name, method, now_s: cost.get(method, 0.0) if is_slow else 0.0) as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.command("specimen", "stop")
        is_slow = False
        diary.calls.clear()
        reply = bench.command("specimen", "initialize", None, "start")
        assert reply.state is State.WORKING
        assert diary.methods() == ["finish", "__init__", "initialize", "start"]


def test_a_time_out_of_the_row_is_kept() -> None:
    with Bench(method_cost_s=lambda *_: 0.3) as bench:
        bench.host(row(timeout_s=0.2), lambda: Specimen(Diary()))
        bench.run(0.25)
        assert bench.state("specimen") is State.FAULTY


def test_commands_that_belong_together_are_carried_out_with_no_cycle_between_and_one_reply() -> None:
    diary = Diary()
    with Bench(method_cost_s=lambda *_: 0.25) as bench:
        bench.host(row(begin="idle"), lambda: Specimen(diary))
        reply = bench.command("specimen", "initialize", None, "start", "goquiet")
        assert (reply.is_accepted, reply.command, reply.state) == (True, "initialize", State.QUIET)
        assert diary.calls == ["__init__", "initialize", "start", "goquiet"]
        assert len(bench.all("components/specimen/reply")) == 1


def test_of_commands_that_belong_together_none_is_carried_out_if_one_has_no_row() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin="idle"), lambda: Specimen(diary))
        reply = bench.command("specimen", "initialize", None, "goquiet")
        assert reply.reason == "goquiet is not accepted in standby; accepted: initialize, start, finish, shutdown"
        assert bench.state("specimen") is State.IDLE
        assert diary.methods() == ["__init__"]


def test_of_commands_that_belong_together_the_rest_is_dropped_when_one_fails() -> None:
    diary = Diary()
    diary.errors["start"] = ValueError("no")
    with Bench() as bench:
        bench.host(row(begin="idle"), lambda: Specimen(diary))
        reply = bench.command("specimen", "initialize", None, "start", "goquiet")
        assert (reply.is_accepted, reply.reason) == (False, "start failed: ValueError: no")
        assert bench.state("specimen") is State.FAULTY
        diary.errors.clear()
        assert bench.command("specimen", "initialize").is_accepted


def test_settings_are_checked_before_anything_is_changed() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin="standby", settings={"offset": 1.0}), lambda: Specimen(diary))
        reply = bench.command("specimen", "initialize", {"ofset": 2.0, "offset": 1e9})
        assert not reply.is_accepted
        assert "unknown setting 'ofset' (did you mean 'offset'?)" in reply.reason
        assert "offset: Expected `float` <= 100.0" in reply.reason
        assert diary.methods().count("initialize") == 1
        assert bench.state("specimen") is State.STANDBY


def test_settings_of_a_command_go_before_those_of_the_row_and_do_not_outlive_the_next_initialize() -> None:
    with Bench() as bench:
        bench.host(row(begin="standby", settings={"offset": 1.0}), lambda: Specimen(Diary()))
        for settings, offset in (({"offset": 7.0}, 7.0), (None, 1.0)):
            bench.command("specimen", "initialize", settings, "start")
            bench.run(0.05)
            assert bench.last("result").value == pytest.approx(bench.loop.time() - 0.05 + offset)
            bench.command("specimen", "stop")


def test_settings_that_are_to_be_kept_take_the_place_of_those_of_the_row_unless_they_are_wrong() -> None:
    with Bench() as bench:
        bench.host(row(begin="standby", settings={"offset": 1.0}), lambda: Specimen(Diary()))
        for given, outcome in ((7.0, True), ("many", False)):
            request(bench, "initialize", request_id=str(given), settings={"offset": given}, is_kept=True)
            bench.run(0.05)
            assert replies(bench)[str(given)].is_accepted is outcome
            bench.command("specimen", "initialize", None, "start")
            bench.run(0.05)
            assert bench.last("result").value == pytest.approx(bench.loop.time() - 0.05 + 7.0)
            bench.command("specimen", "stop")


def test_the_settings_that_are_in_force_are_in_the_log_as_an_event() -> None:
    with Bench() as bench:
        bench.host(row(begin="standby", settings={"offset": 1.5}), lambda: Specimen(Diary()))
        assert bench.last("components/specimen/event").details == '{"offset":1.5}'


def test_wrong_settings_of_a_row_leave_the_component_idle_and_tell_why() -> None:
    with Bench() as bench:
        bench.host(row(settings={"offset": "far"}), lambda: Specimen(Diary()))
        assert bench.state("specimen") is State.IDLE
        assert "offset: Expected `float`, got `str`" in bench.last("components/specimen/event").text


def test_after_a_shutdown_the_component_is_absent_and_silent() -> None:
    with Bench() as bench:
        seen: list[tuple[str, bool]] = []
        bench.exchange.watch("bench/components/*", lambda token, is_alive: seen.append((token, is_alive)))
        bench.host(row(), lambda: Specimen(Diary()))
        assert bench.command("specimen", "shutdown").state is None
        assert bench.last("components/specimen/status").state is None
        assert seen == [("bench/components/specimen", True), ("bench/components/specimen", False)]
        bench.envelopes.clear()
        bench.send("given", Number(value=1.0))
        bench.run(5.0)
        assert [envelope.topic for envelope in bench.envelopes] == ["bench/given"]
        reply = bench.command("specimen", "initialize")
        assert reply.reason == "initialize is not accepted: the component is absent; accepted: create"
        assert bench.call("specimen", "scale", factor=2.0).reason.endswith("it is absent")


def test_an_absent_component_can_be_created_anew_from_its_row() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(settings={"offset": 3.0}), lambda: Specimen(diary))
        bench.call("specimen", "set_rate", rate_hz=50.0)
        bench.command("specimen", "shutdown")
        boot = bench.envelopes[-1].source.boot
        reply = bench.command("specimen", "create")
        assert (reply.is_accepted, reply.state) == (True, State.IDLE)
        status = bench.last("components/specimen/status")
        assert (status.nominal_rate_hz, status.cycles) == (10.0, 0)
        assert bench.envelopes[-1].source.boot != boot
        assert bench.command("specimen", "initialize", None, "start").state is State.WORKING
        assert diary.made == 2
        bench.run(0.05)
        assert bench.last("result").value == 3.0 + bench.loop.time() - 0.05


def test_creation_and_the_way_to_a_state_can_be_one_request() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.command("specimen", "shutdown")
        assert bench.command("specimen", "create", None, "initialize", "start", "goquiet").state is State.QUIET
        assert not bench.command("specimen", "stop", None, "create").is_accepted


def test_a_creation_that_fails_is_refused_and_can_be_tried_again() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.command("specimen", "shutdown")
        diary.errors["__init__"] = OSError("no such device")
        assert bench.command("specimen", "create").reason == "it cannot be created: OSError: no such device"
        diary.errors.clear()
        assert bench.command("specimen", "create").is_accepted


def test_every_start_has_a_new_boot_number_and_sequences_from_zero() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.run(1.0)
        bench.command("specimen", "stop", None, "start")
        bench.run(1.0)
        results = [envelope for envelope in bench.envelopes if envelope.topic == "bench/result"]
        boots = list(dict.fromkeys(envelope.source.boot for envelope in results))
        assert len(boots) == 2
        for boot in boots:
            sequences = [envelope.sequence for envelope in results if envelope.source.boot == boot]
            assert sequences == list(range(len(sequences)))


def test_a_component_never_works_on_what_came_before_its_start() -> None:
    with Bench() as bench:
        bench.host(row(begin="standby"), lambda: Specimen(Diary()))
        bench.send("given", Number(value=5.0))
        bench.command("specimen", "start")
        bench.send("given", Number(value=6.0))
        bench.run(0.05)
        bench.command("specimen", "stop", None, "start")
        bench.run(0.05)
        assert [message.value for message in bench.all("result")] == [0.0, pytest.approx(0.05)]


def test_a_row_that_does_not_fit_its_class_is_an_error_before_anything_runs() -> None:
    wrong = row(trigger="gven", ports={"reslt": "x"}, log=["fctor"])
    with Bench() as bench, pytest.raises(InputError) as error:
        bench.host(wrong, lambda: Specimen(Diary()))
    assert [finding.hint for finding in error.value.findings] == [
        "did you mean 'result'?",
        "did you mean 'given'?",
        "did you mean 'factor'?",
    ]


def test_something_else_on_the_command_topics_is_counted_and_harms_nobody() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        bench.send("components/specimen/command", Number(value=1.0))
        bench.send("components/specimen/function", Number(value=1.0))
        request(bench, "initialize", settings={1: float("nan")})
        bench.send("components/specimen/command", CommandRequest(request_id="y", command=7, then=None))  # type: ignore[arg-type]
        bench.run(1.0)
        status: ComponentStatus = bench.last("components/specimen/status")
        assert (status.state, status.errors) == (State.WORKING, 3)
