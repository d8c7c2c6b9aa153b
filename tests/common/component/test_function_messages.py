"""Function messages: typed, between cycles, while working or quiet; refused, failed, stuck."""

import math
from typing import Any

import pytest

from gloc3.component.component import Component, DataProcessor, function
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.errors import Misuse
from gloc3.messages.envelope import FunctionReply, FunctionRequest, Message

from .specimen import Diary, Driver, Number, Scale, Scaled, Specimen, row


@pytest.mark.parametrize("begin", ["working", "quiet"])
def test_a_function_gets_a_typed_request_and_gives_a_typed_reply(begin: str) -> None:
    with Bench() as bench:
        bench.host(row(begin=begin), lambda: Specimen(Diary()))
        reply = bench.call("specimen", "scale", factor=3)
        assert reply == FunctionReply(
            request_id="1", component="specimen", function="scale", is_accepted=True, result={"before": 1.0}
        )
        assert bench.call("specimen", "scale", factor=1.0).result == {"before": 3.0}


@pytest.mark.parametrize("begin", ["idle", "standby"])
def test_functions_are_refused_outside_of_working_and_quiet(begin: str) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin=begin), lambda: Specimen(diary))
        for name in ("scale", "set_rate"):
            reply = bench.call("specimen", name, factor=3.0)
            assert reply.reason == f"functions are taken while working or quiet; it is {begin}"
        assert "scale" not in diary.calls


@pytest.mark.parametrize(
    ("function_name", "arguments", "reason"),
    [
        ("scael", {"factor": 1.0}, "no function 'scael'; did you mean 'scale'?"),
        ("scale", {}, "scale: Object missing required field `factor`"),
        ("scale", {"factor": "big"}, "scale: Expected `float`, got `str` - at `$.factor`"),
        ("scale", {"factor": 11.0}, "scale: Expected `float` <= 10.0 - at `$.factor`"),
        ("scale", {"factor": math.nan}, "scale: factor is not a finite number"),
        ("scale", {"factor": 1.0, "fcator": 2.0}, "scale: unknown argument 'fcator'; did you mean 'factor'?"),
        ("scale", {"factor": 0.0}, "a factor of 0 is of no use"),
        ("set_logging", {"items": ["nothing"]}, "'nothing' cannot be logged; known: broken, cycles, factor, table"),
    ],
)
def test_bad_arguments_are_a_refusal_and_no_fault(function_name: str, arguments: dict[str, Any], reason: str) -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        reply = bench.call("specimen", function_name, **arguments)
        assert (reply.is_accepted, reply.reason) == (False, reason)
        assert bench.state("specimen") is State.WORKING
        assert bench.hosts["specimen"].errors.total == 0


def test_an_error_in_a_function_is_a_fault_and_its_caller_is_told() -> None:
    diary = Diary()
    diary.errors["scale"] = ValueError("odd")
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        assert bench.call("specimen", "scale", factor=1.0).reason == "scale failed: ValueError: odd"
        assert bench.state("specimen") is State.FAULTY
        assert diary.methods().count("stop") == 1


def test_a_reply_of_another_type_is_a_fault() -> None:
    class Wrong(Specimen):
        @function("scale")
        def scale(self, request: Scale, now_s: float) -> Scaled:
            return Number(value=1.0)  # type: ignore[return-value]

    with Bench() as bench:
        bench.host(row(), lambda: Wrong(Diary()))
        reply = bench.call("specimen", "scale", factor=1.0)
        assert reply.reason == "scale failed: Misuse: function scale gave Number, not Scaled"


def test_functions_run_between_cycles_and_take_the_time_of_those_that_are_due() -> None:
    diary = Diary()
    with Bench(method_cost_s=lambda name, method, now_s: 0.33 if method == "scale" else 0.0) as bench:
        bench.host(row(), lambda: Specimen(diary))
        bench.run(1.05)
        diary.calls.clear()
        assert bench.call("specimen", "scale", factor=2.0).is_accepted
        assert bench.loop.time() == pytest.approx(1.38)
        assert diary.calls == ["scale"]
        status = bench.hosts["specimen"].status()
        assert (status.state, status.overruns) == (State.WORKING, 3)


def test_a_stuck_function_is_a_time_out() -> None:
    with Bench(method_cost_s=lambda name, method, now_s: math.inf if method == "nudge" else 0.0) as bench:
        diary = Diary()
        bench.host(row(), lambda: Driver(diary))
        bench.run(0.5)
        reply = bench.call("specimen", "nudge", factor=2.0)
        assert reply.reason == "nudge failed: timeout: function nudge took over 5 s"
        assert bench.state("specimen") is State.FAULTY
        assert diary.calls[-2:] == ["make_safe", "stop"]


def test_functions_behind_one_that_fails_are_not_carried_out_and_told() -> None:
    diary = Diary()
    with Bench(method_cost_s=lambda name, method, now_s: 0.1 if method == "scale" else 0.0) as bench:
        bench.host(row(rate_hz=1.0), lambda: Specimen(diary))
        diary.errors["scale"] = ValueError("odd")
        for number in range(3):
            arguments = {"factor": 1.0}
            bench.send(
                "components/specimen/function",
                FunctionRequest(request_id=str(number), function="scale", arguments=arguments),
            )
        bench.run(1.0)
        reasons = [reply.reason for reply in bench.all("components/specimen/function_reply")]
        assert reasons == ["scale failed: ValueError: odd"] + ["scale was not carried out: ValueError: odd"] * 2
        assert diary.calls.count("scale") == 1


def test_only_so_many_functions_may_wait() -> None:
    with Bench(method_cost_s=lambda name, method, now_s: 0.1 if method == "scale" else 0.0) as bench:
        bench.host(row(rate_hz=1.0), lambda: Specimen(Diary()))
        for number in range(20):
            bench.send(
                "components/specimen/function",
                FunctionRequest(request_id=str(number), function="scale", arguments={"factor": 1.0}),
            )
        bench.run(3.0)
        replies = bench.all("components/specimen/function_reply")
        assert [reply.is_accepted for reply in replies].count(True) == 16
        assert {reply.reason for reply in replies} == {"", "busy: 16 functions wait already"}


def test_a_function_must_say_its_types() -> None:
    with pytest.raises(Misuse, match="must be"):

        class Untyped(Specimen):
            @function("untyped")
            def untyped(self, request: Any, now_s: float) -> Message:
                raise NotImplementedError


@pytest.mark.parametrize("name", ["set_rate", "twice"])
def test_two_functions_of_one_name_are_a_mistake(name: str) -> None:
    with pytest.raises(Misuse, match="already exists"):

        class Double(DataProcessor):  # type: ignore[type-arg]
            def work(self, now_s: float, inbox: Any) -> list[Any]:
                return []

            @function(name)
            def one(self, request: Scale, now_s: float) -> Scaled:
                return Scaled(before=0.0)

            @function(name)
            def two(self, request: Scale, now_s: float) -> Scaled:
                return Scaled(before=0.0)


def test_what_a_class_declares_can_be_read_from_it() -> None:
    assert list(Specimen.inputs) == ["given", "every"]
    assert list(Specimen.outputs) == ["result"]
    assert Specimen.functions["scale"].doc == "Sets the factor."
    assert issubclass(Specimen, Component)
