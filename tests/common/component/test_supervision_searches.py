"""Supervision in any course of events, and over real hosts."""

from collections.abc import Callable, Sequence
from functools import partial
from heapq import heappop, heappush
from itertools import pairwise
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.supervised import reply_to, row, status

from gloc3.component.deployment import FaultPolicy
from gloc3.component.lci import OPERATING, Command, State, transition
from gloc3.component.supervision import LciRequest, Step, Supervision, SupervisionVerdict
from gloc3.component.test_bench import Bench
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope

from .specimen import Diary, Specimen

# --- any course of events ---

TRIO = (
    row("main", on_fault={"standby": "spare", "reinitialize": {"times": 3, "back_off_s": 0.2}, "then": "land"}),
    row("spare", begin="quiet", standby_for="main", on_fault={"reinitialize": {"times": 3}}),
    row("third", begin="quiet", standby_for="main"),
)
NAMES = tuple(item.name for item in TRIO)


class Fleet:
    """Hosts reduced to their state table, which obey orders at once; some are broken, some are mute."""

    def __init__(self) -> None:
        self.supervision = Supervision(TRIO)
        self.states: dict[str, State] = {"main": State.WORKING, "spare": State.QUIET, "third": State.QUIET}
        self.broken: set[str] = set()
        self.mute: set[str] = set()
        self.now_s = 0.0
        self.verdicts: list[SupervisionVerdict] = []
        self.attempts: dict[str, list[float]] = {name: [] for name in NAMES}
        for name in NAMES:
            self._report(name)

    def _report(self, name: str) -> None:
        if name not in self.mute:
            cause = f"since {self.now_s:g}"
            self._obey(self.supervision.receive_status(status(name, self.states[name], cause), self.now_s))

    def _obey(self, steps: Sequence[Step]) -> None:
        orders = [step for step in steps if isinstance(step, LciRequest)]
        resumes = [order.request.command == Command.RESUME for order in orders]
        assert resumes == sorted(resumes, reverse=True), "a standby comes first"
        for step in steps:
            if isinstance(step, SupervisionVerdict):
                assert self.states[step.component] not in OPERATING or step.component in self.mute
                self.verdicts.append(step)
            elif step.component not in self.mute:
                self._carry_out(step)

    def _carry_out(self, order: LciRequest) -> None:
        name, refusal = order.component, ""
        if order.request.command == Command.INITIALIZE:
            self.attempts[name].append(self.now_s)
        state: State = self.states[name]
        for word in (order.request.command, *order.request.then):
            try:
                to = transition(state, Command(word)).to
            except Refused as error:
                refusal = str(error)
                break
            assert to is not None
            if name in self.broken:
                state, refusal = State.FAULTY, f"{word} failed"
                break
            state = to
        self.states[name] = state
        self._report(name)
        self._obey(self.supervision.receive_reply(reply_to(order, state, refusal), self.now_s))

    def break_down(self, name: str) -> None:
        """A component turns faulty, and stays broken."""
        self.broken.add(name)
        self.states[name] = State.FAULTY
        self._report(name)

    def pass_time(self, duration_s: float) -> None:
        """Statuses come every second, and what is due is done in time."""
        end_s = self.now_s + duration_s
        while self.now_s < end_s:
            next_s = self.supervision.next_tick_s()
            self.now_s = min(end_s, int(self.now_s) + 1.0, max(self.now_s, next_s if next_s is not None else end_s))
            if self.now_s == int(self.now_s):
                for name in NAMES:
                    self._report(name)
            self._obey(self.supervision.tick(self.now_s))
            due_s = self.supervision.next_tick_s()
            assert due_s is None or due_s > self.now_s, "what is due has been done"

    def working(self) -> list[str]:
        """Who is not quiet, of those that can be heard."""
        return [name for name in NAMES if self.states[name] is State.WORKING and name not in self.mute]


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["break", "mend", "mute", "unmute", "goquiet", "stop", "wait", "wait", "wait"]),
        st.sampled_from(NAMES),
        st.sampled_from([0.1, 1.0, 4.0]),
    ),
    max_size=25,
)


@settings(max_examples=60)
@given(STEPS)
def test_in_any_course_of_events_at_most_one_with_the_same_outputs_is_not_quiet(
    steps: list[tuple[str, str, float]],
) -> None:
    fleet = Fleet()
    for what, name, duration_s in steps:
        match what:
            case "break":
                fleet.break_down(name)
            case "mend":
                fleet.broken.discard(name)
            case "mute":
                fleet.mute.add(name)
            case "unmute":
                fleet.mute.discard(name)
            case "wait":
                fleet.pass_time(duration_s)
            case command:
                try:
                    to = transition(fleet.states[name], Command(command)).to
                except Refused:
                    continue
                assert to is not None
                fleet.states[name] = to
                fleet._report(name)
        if not fleet.mute:
            fleet.pass_time(1.0)
            assert len(fleet.working()) <= 1
    if any(what == "mute" for what, _, _ in steps):
        fleet.mute.clear()
        fleet.pass_time(5.0)
        assert len(fleet.working()) <= 1
    for name in NAMES:
        pauses_s = [b - a for a, b in pairwise(fleet.attempts[name])]
        assert all(pause_s > 0.19 for pause_s in pauses_s)


@settings(max_examples=60)
@given(st.lists(st.sampled_from(NAMES), min_size=1, max_size=3), st.floats(0.0, 10.0))
def test_while_one_of_a_group_can_work_one_does_and_there_is_no_verdict(names: list[str], pause_s: float) -> None:
    fleet = Fleet()
    for name in names:
        fleet.break_down(name)
        fleet.pass_time(pause_s)
    if len(set(names)) < 3:
        assert len(fleet.working()) == 1
        assert fleet.verdicts == []
    else:
        fleet.pass_time(20.0)
        assert [verdict.policy for verdict in fleet.verdicts] == [FaultPolicy.LAND]


class SlowFleet:
    """Hosts that take random times for each order, fail at times, and may be lost and come back."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.supervision = Supervision(TRIO)
        self.states: dict[str, State] = {"main": State.WORKING, "spare": State.QUIET, "third": State.QUIET}
        self.gone: set[str] = set()
        self.busy: dict[str, int] = {}
        self.now_s, self.calm_s = 0.0, 20.0
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._made = 0

    def later(self, delay_s: float, act: Callable[[], None]) -> None:
        """Does something after a while."""
        self._made += 1
        heappush(self._due, (self.now_s + delay_s, self._made, act))

    def report(self, name: str) -> None:
        """A component tells its state."""
        if name not in self.gone:
            self.obey(self.supervision.receive_status(status(name, self.states[name], "odd"), self.now_s))

    def obey(self, steps: Sequence[Step]) -> None:
        """Sends orders to the hosts."""
        for step in steps:
            if isinstance(step, LciRequest):
                words = (step.request.command, *step.request.then)
                self.later(self.random.uniform(0.0, 0.05), partial(self._begin, step, words))

    def _begin(self, order: LciRequest, words: tuple[str, ...]) -> None:
        if order.component in self.busy:
            self._reply(order, "busy")
        else:
            self.busy[order.component] = self._made
            self._go_on(order, words, self._made)

    def _go_on(self, order: LciRequest, words: tuple[str, ...], number: int) -> None:
        name, to, refusal = order.component, None, ""
        try:
            to = transition(self.states[name], Command(words[0])).to if words else None
        except Refused as error:
            refusal = str(error)
        if to is None:
            del self.busy[name]
            self._reply(order, refusal)
            return
        times = [0.0, 0.01, 0.05, 0.2] if words[0] in ("resume", "goquiet") else [0.0, 0.01, 0.3, 0.9, 1.5]
        self.later(self.random.choice(times), partial(self._end, order, words, to, number))

    def _end(self, order: LciRequest, words: tuple[str, ...], to: State, number: int) -> None:
        name = order.component
        if self.busy.get(name) != number:  # it has failed or gone meanwhile
            return
        if self.now_s < self.calm_s and self.random.random() < 0.1:
            self.fail(name)
            self._reply(order, f"{words[0]} failed")
            return
        self.states[name] = to
        self.report(name)
        self._go_on(order, words[1:], number)

    def _reply(self, order: LciRequest, refusal: str) -> None:
        reply = reply_to(order, self.states[order.component], refusal)
        if order.component not in self.gone:
            self.later(0.02, lambda: self.obey(self.supervision.receive_reply(reply, self.now_s)))

    def fail(self, name: str) -> None:
        """A component turns faulty."""
        self.busy.pop(name, None)
        self.states[name] = State.FAULTY
        self.report(name)

    def lose(self, name: str) -> None:
        """A component is lost with its host; perhaps that is noticed at once, and perhaps it comes back."""
        self.busy.pop(name, None)
        self.gone.add(name)
        if self.random.random() < 0.5:
            self.obey(self.supervision.lose(name, "its host is lost", self.now_s))
        if self.random.random() < 0.5:
            self.states[name] = State.FAULTY
            self.later(self.random.uniform(0.3, 4.0), partial(self.gone.discard, name))

    def run(self, end_s: float) -> None:
        """Statuses come every second."""
        for name in NAMES:
            self.report(name)
        while self.now_s < end_s:
            self.now_s = round(self.now_s + 0.05, 2)
            while self._due and self._due[0][0] <= self.now_s:
                heappop(self._due)[2]()
            if self.now_s == int(self.now_s):
                for name in NAMES:
                    self.report(name)
            self.obey(self.supervision.tick(self.now_s))


@pytest.mark.parametrize("seed", range(150))
def test_whatever_fails_while_orders_take_their_time_one_works_in_the_end_if_any_can(seed: int) -> None:
    fleet = SlowFleet(seed)
    for _ in range(fleet.random.randint(1, 5)):
        act = fleet.random.choice([fleet.fail, fleet.fail, fleet.lose])
        fleet.later(fleet.random.uniform(1.0, 18.0), partial(act, fleet.random.choice(NAMES)))
    fleet.run(60.0)
    here = [name for name in NAMES if name not in fleet.gone]
    working = [name for name in here if fleet.states[name] is State.WORKING]
    can_work = [name for name in here if fleet.states[name] in OPERATING]
    assert len(working) == min(1, len(can_work)), fleet.states


# --- over real hosts ---


def test_over_real_hosts_the_output_goes_on_within_100_ms_and_the_old_primary_becomes_the_standby() -> None:
    diaries = {"main": Diary(), "spare": Diary()}
    rows = [
        row("main", rate_hz=50.0, on_fault={"standby": "spare", "reinitialize": {"times": 3}}),
        row("spare", rate_hz=50.0, begin="quiet", standby_for="main"),
    ]
    supervision = Supervision(rows)
    received: list[tuple[float, str]] = []
    with Bench() as bench:

        def obey(steps: list[Step]) -> None:
            for step in steps:
                assert isinstance(step, LciRequest)
                topic = f"bench/components/{step.component}/command"
                bench._publisher.publish(topic, step.request, bench.loop.time())

        def receive(envelope: Envelope[Any]) -> None:
            now_s = bench.loop.time()
            if envelope.topic.endswith("/status"):
                obey(supervision.receive_status(envelope.payload, now_s))
            elif envelope.topic.endswith("/reply"):
                obey(supervision.receive_reply(envelope.payload, now_s))

        bench.exchange.subscribe("bench/components/**", receive)
        bench.exchange.subscribe("bench/result", lambda e: received.append((bench.loop.time(), e.source.component)))
        for item in rows:
            bench.host(item, lambda name=item.name: Specimen(diaries[name]))  # type: ignore[misc]
        bench.run(2.0)
        diaries["main"].errors["work"] = ValueError("odd")
        for _ in range(100):
            bench.run(0.1)
            obey(supervision.tick(bench.loop.time()))
            diaries["main"].errors.clear()
        assert (bench.state("main"), bench.state("spare")) == (State.QUIET, State.WORKING)
        assert max(b[0] - a[0] for a, b in pairwise(received)) < 0.1
        speakers = [name for _, name in received]
        assert speakers == sorted(speakers)
        assert set(speakers) == {"main", "spare"}
        diaries["spare"].errors["work"] = ValueError("odd")
        bench.run(0.2)
        assert bench.state("main") is State.WORKING
