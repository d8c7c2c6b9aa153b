"""The host as a machine under random commands, functions, faults, costs and times: what must always hold."""

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from gloc3.component.host import CREATE
from gloc3.component.lci import TABLE, Command, State
from gloc3.component.test_bench import Bench
from gloc3.errors import Refused
from gloc3.messages.envelope import CommandRequest, Envelope, FunctionRequest

from .specimen import Diary, Driver, row

METHODS = ["initialize", "start", "goquiet", "resume", "stop", "finish", "work", "actuate", "make_safe", "nudge"]
WORDS = [*Command, CREATE, "nonsense"]


class Watched(Driver):
    """A driver that knows the rules by which a host may call it."""

    def __init__(self, diary: Diary) -> None:
        self.phase = "raw"
        super().__init__(diary)

    def _expect(self, call: str, *phases: str) -> None:
        assert self.phase in phases, f"{call} while {self.phase}"

    def initialize(self, settings: Any) -> None:
        self._expect("initialize", "raw", "finished", "initialized", "stopped")
        self.phase = "initialized"
        super().initialize(settings)

    def start(self) -> None:
        self._expect("start", "initialized", "stopped")
        self.phase = "started"
        super().start()

    def work(self, now_s: float, inbox: Any) -> Any:
        self._expect("work", "started")
        return super().work(now_s, inbox)

    def goquiet(self) -> None:
        self._expect("goquiet", "started")
        super().goquiet()

    def resume(self) -> None:
        self._expect("resume", "started")
        super().resume()

    def stop(self) -> None:
        self._expect("stop", "started")
        self.phase = "stopped"
        super().stop()

    def finish(self) -> None:
        self._expect("finish", "initialized", "stopped", "raw", "started", "finished")
        self.phase = "finished"
        super().finish()


class HostMachine(RuleBasedStateMachine):
    """One driver on a bench."""

    @initialize(begin=st.sampled_from(["idle", "standby", "working", "quiet"]))
    def begin(self, begin: str) -> None:
        self.diary = Diary()
        self.cycle_cost_s = 0.0
        self.method_cost_s: dict[str, float] = {}
        self.requested: set[str] = set()
        self.sequences: dict[tuple[str, int], int] = {}
        self.bench = Bench(
            cycle_cost_s=lambda name, now_s: self.cycle_cost_s,
            method_cost_s=lambda name, method, now_s: self.method_cost_s.get(method, 0.0),
        )
        self.bench.exchange.subscribe("bench/**", self._watch)
        self.diary.acts["actuate"] = self._check_write
        self.bench.host(row(begin=begin, timeout_s=1.0), lambda: Watched(self.diary))

    def _check_write(self) -> None:
        assert self.bench.state("specimen") is State.WORKING

    def _watch(self, envelope: Envelope[Any]) -> None:
        if envelope.source.component != "specimen":
            return
        key = (envelope.topic, envelope.source.boot)
        assert envelope.sequence == self.sequences.get(key, -1) + 1
        self.sequences[key] = envelope.sequence
        if envelope.topic == "bench/done":
            assert self.bench.state("specimen") is State.WORKING

    @rule(word=st.sampled_from(WORDS), then=st.lists(st.sampled_from(WORDS), max_size=2))
    def command(self, word: str, then: list[str]) -> None:
        request_id = f"c{len(self.requested)}"
        self.requested.add(request_id)
        message = CommandRequest(request_id=request_id, command=word, then=tuple(then))
        self.bench.send("components/specimen/command", message)

    @rule(offset=st.sampled_from([1.0, 1e9, "far", None]))
    def configure(self, offset: Any) -> None:
        request_id = f"i{len(self.requested)}"
        self.requested.add(request_id)
        message = CommandRequest(request_id=request_id, command="initialize", settings={"offset": offset})
        self.bench.send("components/specimen/command", message)

    @rule(name=st.sampled_from(["nudge", "set_rate", "nothing"]))
    def call(self, name: str) -> None:
        request_id = f"f{len(self.requested)}"
        self.requested.add(request_id)
        arguments = {"factor": 1.0} if name == "nudge" else {"rate_hz": 20.0}
        self.bench.send(
            "components/specimen/function",
            FunctionRequest(request_id=request_id, function=name, arguments=arguments),
        )

    @rule(
        method=st.sampled_from([*METHODS, "check_leaving"]),
        error=st.sampled_from([ValueError("odd"), SystemExit(1), Refused("no")]),
    )
    def break_method(self, method: str, error: BaseException) -> None:
        self.diary.errors[method] = error

    @rule(method=st.sampled_from(METHODS))
    def mend_method(self, method: str) -> None:
        self.diary.errors.pop(method, None)

    @rule(cost_s=st.sampled_from([0.0, 0.0, 0.03, 0.15, float("inf")]))
    def make_cycles_cost(self, cost_s: float) -> None:
        self.cycle_cost_s = cost_s

    @rule(method=st.sampled_from(METHODS), cost_s=st.sampled_from([0.0, 0.3, 2.0, float("inf")]))
    def make_method_cost(self, method: str, cost_s: float) -> None:
        self.method_cost_s[method] = cost_s

    @rule(duration_s=st.sampled_from([0.0, 0.05, 0.1, 0.7, 1.5]))
    def let_time_pass(self, duration_s: float) -> None:
        self.bench.run(duration_s)

    @precondition(lambda self: not self.bench.hosts["specimen"].is_beginning)
    @rule(command=st.sampled_from(list(Command)))
    def a_command_does_what_the_table_says_or_turns_faulty(self, command: Command) -> None:
        self.bench.run(2.5)  # whatever was under way has ended
        before = self.bench.state("specimen")
        reply = self.bench.command("specimen", command)
        after = self.bench.state("specimen")
        expected = TABLE[before].get(command) if before is not None else None
        if reply.is_accepted:
            assert expected is not None
            assert reply.state is expected.to
        else:
            assert after in (before, State.FAULTY)
            assert reply.reason

    @rule()
    def it_can_always_be_brought_up_again(self) -> None:
        self.diary.errors.clear()
        self.method_cost_s.clear()
        self.cycle_cost_s = 0.0
        self.bench.run(5.0)
        state = self.bench.state("specimen")
        if state is None:
            assert self.bench.command("specimen", CREATE).is_accepted
        elif state in (State.WORKING, State.QUIET):
            assert self.bench.command("specimen", Command.STOP).is_accepted
        assert self.bench.command("specimen", Command.INITIALIZE, None, Command.START).state is State.WORKING
        writes = len(self.diary.writes)
        self.bench.run(0.5)
        assert len(self.diary.writes) > writes

    @invariant()
    def the_last_status_tells_the_state(self) -> None:
        assert self.bench.last("components/specimen/status").state is self.bench.state("specimen")

    @invariant()
    def nobody_is_answered_twice(self) -> None:
        replies = [
            reply.request_id
            for topic in ("reply", "function_reply")
            for reply in self.bench.all(f"components/specimen/{topic}")
            if reply.request_id in self.requested
        ]
        assert len(replies) == len(set(replies))

    @invariant()
    def nothing_escapes_into_the_loop(self) -> None:
        assert self.bench.loop.failures == []

    def teardown(self) -> None:
        self.diary.errors.clear()
        self.bench.run(10.0)
        answered = {
            reply.request_id
            for topic in ("reply", "function_reply")
            for reply in self.bench.all(f"components/specimen/{topic}")
        }
        lost = {request_id for request_id in self.requested - answered if not request_id.startswith("f")}
        self.bench.__exit__(None, None, None)
        assert not lost, f"never answered: {lost}"


HostMachine.TestCase.settings = settings(max_examples=25, stateful_step_count=25, derandomize=True)


TestHostUnderRandomUse = HostMachine.TestCase
