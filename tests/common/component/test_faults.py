"""Errors under the host: whatever an author's code does, its component turns faulty and nothing else happens."""

import asyncio
import gc
import os
import signal
from functools import partial
from random import Random
from typing import Any
from weakref import ReferenceType, ref

import pytest

from gloc3.clock import Clock, run_virtual
from gloc3.component.component import SensorSampler
from gloc3.component.context import HostContext
from gloc3.component.host import ComponentHost
from gloc3.component.lci import State
from gloc3.component.ports import Actuation, PortReport
from gloc3.component.settings import NoSettings
from gloc3.component.test_bench import Bench
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.envelope import Event, Severity
from gloc3.messages.topics import TopicTable

from .specimen import Diary, Number, Specimen, row

HARMS = [
    ValueError("odd"),
    SystemExit(3),
    asyncio.CancelledError(),
    GeneratorExit(),
    RecursionError("deep"),
    MemoryError(),
    StopIteration(),
]


class Unspeakable(Exception):
    """An error that cannot even be told."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


@pytest.mark.parametrize("method", ["initialize", "start", "goquiet", "resume", "stop", "finish", "work", "scale"])
@pytest.mark.parametrize("error", [*HARMS, Unspeakable()], ids=repr)
def test_whatever_a_method_raises_makes_its_component_faulty_and_harms_no_other(
    method: str, error: BaseException
) -> None:
    diary, other = Diary(), Diary()
    with Bench() as bench:
        bench.host(row("other", ports={"result": "other"}), lambda: Specimen(other))
        bench.host(row(begin="idle"), lambda: Specimen(diary))
        diary.errors[method] = error
        for command in ("initialize", "start", "goquiet", "resume"):
            bench.command("specimen", command)
        bench.run(0.1)
        bench.call("specimen", "scale", factor=1.0)
        for command in ("stop", "finish"):
            if bench.state("specimen") is not State.FAULTY:
                bench.command("specimen", command)
        assert bench.state("specimen") is State.FAULTY
        status = bench.last("components/specimen/status")
        assert (status.state, status.errors >= 1) == (State.FAULTY, True)
        assert status.cause.startswith("out of memory" if isinstance(error, MemoryError) else type(error).__name__)
        assert bench.state("other") is State.WORKING
        diary.errors.clear()
        assert bench.command("specimen", "initialize", None, "start").is_accepted
        bench.run(0.3)
        assert bench.last("other").value == pytest.approx(bench.loop.time(), abs=0.11)


def test_a_component_that_runs_out_of_memory_is_let_go_with_all_that_it_holds() -> None:
    diary = Diary()
    made: list[ReferenceType[Specimen]] = []

    def create() -> Specimen:
        specimen = Specimen(diary)
        made.append(ref(specimen))
        return specimen

    with Bench() as bench:
        bench.host(row(), create)
        bench.run(0.1)
        diary.errors["work"] = MemoryError()
        bench.run(0.2)
        assert bench.state("specimen") is State.FAULTY
        gc.collect()
        assert [one() is not None for one in made] == [False, True], "another one has taken its place"
        diary.errors.clear()
        assert bench.command("specimen", "initialize", None, "start").is_accepted
        assert bench.state("specimen") is State.WORKING
        assert len(made) == 2


def test_a_keyed_output_takes_reports_with_a_key_and_nothing_else() -> None:
    class Keyed(Specimen):
        def work(self, now_s: float, inbox: Any) -> Any:
            if self.cycles:
                return [Number(value=now_s)]
            self.cycles = 1
            return [self.result.report(Number(value=1.0), key="a"), self.result.report(Number(value=2.0), key="b")]

    with Bench() as bench:
        bench.host(row(ports={"result": "to/{key}"}), lambda: Keyed(Diary()))
        bench.run(0.05)
        assert (bench.last("to/a").value, bench.last("to/b").value) == (1.0, 2.0)
        bench.run(0.1)
        assert bench.last("components/specimen/status").cause.startswith("Misuse: Keyed reported Number, which fits no")
        assert bench.all("to/{key}") == []


def virtual_hosts(*diaries: Diary) -> list[ComponentHost]:
    """Working components, one for each diary, in the running loop of virtual time."""
    loop = asyncio.get_running_loop()
    context = HostContext("site", LocalExchange(), Clock(loop), loop, TopicTable(), Random(1))
    hosts = []
    for number, diary in enumerate(diaries):
        name = f"specimen{number}"
        hosts.append(ComponentHost(row(name, ports={"result": name}), partial(Specimen, diary), context))
        hosts[-1].begin()
    return hosts


def test_an_author_who_raises_the_interrupt_in_virtual_time_harms_only_himself() -> None:
    async def main() -> tuple[list[State | None], str]:
        diary = Diary()
        hosts = virtual_hosts(diary, Diary())
        await asyncio.sleep(1.0)
        diary.errors["work"] = KeyboardInterrupt()
        await asyncio.sleep(1.0)
        return [host.state for host in hosts], str(hosts[0].errors.last_cause)

    assert run_virtual(main()) == ([State.FAULTY, State.WORKING], "KeyboardInterrupt")


def test_an_operators_interrupt_ends_what_runs_in_virtual_time() -> None:
    diary = Diary()

    async def main() -> None:
        virtual_hosts(diary)
        diary.acts["work"] = lambda: os.kill(os.getpid(), signal.SIGINT)
        await asyncio.sleep(1e6)

    with pytest.raises(KeyboardInterrupt):
        run_virtual(main())
    assert diary.calls.count("work") < 3


def test_an_operators_interrupt_goes_through() -> None:
    diary = Diary()
    diary.errors["work"] = KeyboardInterrupt()
    with Bench() as bench, pytest.raises(KeyboardInterrupt):
        bench.host(row(), lambda: Specimen(diary))


@pytest.mark.parametrize(
    ("results", "cause"),
    [
        (None, "no cause"),
        (5, "TypeError: 'int' object is not iterable"),
        (Number(value=1.0), "TypeError: 'Number' object is not iterable"),
        ([None], "Misuse: Specimen reported NoneType, which fits no single output of its class"),
        ("text", "Misuse: Specimen reported str, which fits no single output of its class"),
        ([Event(severity=Severity.INFO, text="")], "Misuse: Specimen reported Event, which fits no single output"),
        ([PortReport("nowhere", Number(value=1.0))], "Misuse: Specimen has no output 'nowhere'"),
        ([PortReport("given", Number(value=1.0))], "Misuse: Specimen has no output 'given'"),
        ([PortReport("result", 7)], "Misuse: Specimen.result takes Number, not int"),  # type: ignore[arg-type]
        ([PortReport("result", Number(value=1.0), t_s=float("nan"))], "Misuse: Specimen.result: nan is no time of"),
        ([PortReport("result", Number(value=1.0), t_s="now")], "Misuse: Specimen.result: 'now' is no time of"),  # type: ignore[arg-type]
        ([PortReport("result", Number(value=1.0), key="a")], "Misuse: Specimen.result: 'a' is no key for bench/result"),
        ([Actuation(1.0)], "Misuse: Specimen is no actuator driver"),
    ],
)
def test_rubbish_from_work_is_a_fault_that_says_what_is_wrong_and_publishes_nothing(results: Any, cause: str) -> None:
    class Rubbish(Specimen):
        def work(self, now_s: float, inbox: Any) -> Any:
            return results

    Rubbish.__name__ = "Specimen"
    with Bench() as bench:
        bench.host(row(), lambda: Rubbish(Diary()))
        bench.run(0.05)
        assert bench.state("specimen") is State.FAULTY
        if results is not None:
            assert bench.last("components/specimen/status").cause.startswith(cause)
        assert bench.all("result") == []


@pytest.mark.parametrize("begin", ["working", "quiet"])
def test_stop_is_called_once_on_a_fault_and_finish_before_the_initialize_that_leads_out(begin: str) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin=begin), lambda: Specimen(diary))
        diary.errors["work"] = ValueError("odd")
        bench.run(1.0)
        diary.errors.clear()
        assert diary.methods()[-1] == "stop"
        assert diary.methods().count("stop") == 1
        diary.calls.clear()
        assert bench.command("specimen", "initialize").state is State.STANDBY
        assert diary.calls == ["finish", "initialize"]


@pytest.mark.parametrize("way_out", ["initialize", "finish", "shutdown"])
def test_what_stop_and_finish_raise_in_and_after_a_fault_is_only_counted(way_out: str) -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        for method in ("work", "stop", "finish"):
            diary.errors[method] = ValueError(method)
        bench.run(0.1)
        assert bench.last("components/specimen/status").cause == "ValueError: work"
        assert bench.hosts["specimen"].errors.total == 2
        assert bench.command("specimen", way_out).is_accepted
        assert list(bench.hosts["specimen"].errors.causes)[1:] == [
            "stop: ValueError: stop",
            "finish: ValueError: finish",
        ]


def test_an_error_in_stop_itself_does_not_call_it_again() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        diary.errors["stop"] = ValueError("odd")
        assert bench.command("specimen", "stop").reason == "stop failed: ValueError: odd"
        assert diary.methods().count("stop") == 1


def test_a_command_behind_a_cycle_that_fails_is_not_carried_out_and_stop_is_called_once() -> None:
    diary = Diary()
    with Bench(cycle_cost_s=lambda name, now_s: 0.1) as bench:
        bench.host(row(rate_hz=1.0), lambda: Specimen(diary))
        bench.run(0.95)
        diary.errors["work"] = ValueError("odd")
        bench.run(0.1)
        for command in ("goquiet", "stop"):
            diary.calls.clear()
            reply = bench.command("specimen", command)
            assert (reply.is_accepted, reply.state) == (False, State.FAULTY)
            assert reply.reason == f"{command} was not carried out: ValueError: odd"
            assert diary.methods() == ["stop"]
            bench.command("specimen", "initialize", None, "start")
            bench.run(0.05)


def test_an_error_in_goquiet_stops_the_component() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        diary.errors["goquiet"] = ValueError("odd")
        bench.command("specimen", "goquiet")
        assert diary.methods()[-2:] == ["goquiet", "stop"]


@pytest.mark.parametrize("method", ["initialize", "start"])
def test_an_error_outside_of_working_and_quiet_calls_no_stop(method: str) -> None:
    diary = Diary()
    diary.errors[method] = ValueError("odd")
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        assert bench.state("specimen") is State.FAULTY
        assert "stop" not in diary.calls


class TwoDevices(SensorSampler[NoSettings]):
    """Opens one device, then another; writes down what happens to the first."""

    def __init__(self, diary: Diary) -> None:
        self._diary = diary

    def start(self) -> None:
        self._diary.note("open")
        self.until_stop.callback(self._diary.note, "close")
        self._diary.note("second")

    def work(self, now_s: float, inbox: Any) -> Any:
        return []


@pytest.mark.parametrize("error", [Gloc3Error("not there"), Refused("not now"), MemoryError()], ids=repr)
def test_what_a_start_that_fails_has_opened_is_closed(error: Exception) -> None:
    diary = Diary()
    diary.errors["second"] = error
    with Bench() as bench:
        bench.host(row(begin="idle"), lambda: TwoDevices(diary))
        assert not bench.command("specimen", "initialize", None, "start").is_accepted
        assert diary.calls == ["open", "second", "close"]
        diary.errors.clear()
        assert bench.command("specimen", "initialize", None, "start").is_accepted
        bench.command("specimen", "stop")
        assert diary.calls == ["open", "second", "close"] * 2


def test_an_error_in_closing_what_a_failed_start_has_opened_is_only_counted() -> None:
    diary = Diary()
    diary.errors = {"second": Gloc3Error("not there"), "close": ValueError("odd")}
    with Bench() as bench:
        bench.host(row(), lambda: TwoDevices(diary))
        assert bench.last("components/specimen/status").cause == "not there"
        assert list(bench.hosts["specimen"].errors.causes) == ["stop: ValueError: odd", "not there"]


def test_the_error_handler_keeps_cause_count_first_and_last_time_and_tells_the_traceback_once() -> None:
    diary = Diary()
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        diary.errors["work"] = ValueError("odd")
        for _ in range(3):
            bench.run(1.0)
            bench.command("specimen", "initialize", None, "start")
        bench.run(1.0)
        status = bench.last("components/specimen/status")
        assert (status.errors, status.cause) == (4, "ValueError: odd")
        assert (status.cause_first_s, status.cause_last_s) == (0.1, 3.0)
        reported = [e for e in bench.all("components/specimen/event") if e.severity is Severity.ERROR]
        assert [bool(event.details) for event in reported] == [True, False, False, False]
        assert reported[0].details.endswith("ValueError: odd")
        assert "specimen.py" in reported[0].details
        assert "/" not in reported[0].details.replace(" / ", "")


def test_what_is_wrong_outside_the_program_is_told_once_in_its_own_words_and_without_a_traceback() -> None:
    diary = Diary()
    diary.errors["start"] = Gloc3Error("/dev/video0 is not there; is it plugged in?")
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(diary))
        (reported,) = [e for e in bench.all("components/specimen/event") if e.severity is Severity.ERROR]
        assert (reported.text, reported.details) == (
            "standby -> faulty: /dev/video0 is not there; is it plugged in?",
            "",
        )


def test_a_fault_while_beginning_ends_the_begin() -> None:
    diary = Diary()
    diary.errors["initialize"] = ValueError("odd")
    with Bench() as bench:
        host = bench.host(row(begin="quiet"), lambda: Specimen(diary))
        assert not host.is_beginning
        assert diary.methods() == ["__init__", "initialize"]


def test_a_failed_publication_is_the_components_fault() -> None:
    with Bench() as bench:
        bench.host(row(begin="standby"), lambda: Specimen(Diary()))
        publish = bench.exchange.publish

        def refuse_numbers(envelope: Any) -> None:
            if isinstance(envelope.payload, Number):
                raise TypeError("cannot be encoded")
            publish(envelope)

        bench.exchange.publish = refuse_numbers  # type: ignore[method-assign]
        bench.command("specimen", "start")
        bench.run(0.1)
        assert bench.last("components/specimen/status").cause == "TypeError: cannot be encoded"


def test_a_message_of_another_type_on_an_input_is_counted_and_told_once() -> None:
    with Bench() as bench:
        bench.host(row(), lambda: Specimen(Diary()))
        for _ in range(3):
            bench.send("given", Event(severity=Severity.INFO, text="hello"))
        bench.run(0.1)
        assert bench.hosts["specimen"].errors.total == 3
        reported = [e.text for e in bench.all("components/specimen/event") if e.severity is Severity.WARNING]
        assert reported == ["input given takes Number; bench/given brought Event"]
        assert bench.state("specimen") is State.WORKING
