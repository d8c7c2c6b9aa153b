"""Whatever happens, in whatever order: claims stay exclusive, the order is kept, and an abort ends the mission."""

from contextlib import suppress
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from gloc3.errors import Refused
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ENDED, ActionState
from gloc3.mission.reading.writer import single_action
from gloc3.platform.platform import Platform
from gloc3.platform.reader import read_platform

from .conftest import PELICAN
from .executor_rig import Rig

PLATFORM: Platform = read_platform(PELICAN, "pelican.yaml")
POLICIES = st.sampled_from(["", *(policy.value for policy in Policy)])
CONDITION_POLICIES = st.sampled_from(["continue", "hold", "return", "land", "abort"])
TARGETS = st.sampled_from(
    ["", "up", "work", "work.fly", "work.look", "work.rest", "work.on", "end", "end.down", "none"]
)
VERBS = st.sampled_from(["start", "pause", "resume", "skip", "abort", "retry"])


@st.composite
def missions(draw: st.DrawFn) -> str:
    """Three tasks with parallel actions, and any policies, retries and deadlines."""

    def extras() -> str:
        policy, retries = draw(POLICIES), draw(st.integers(0, 2))
        deadline = draw(st.sampled_from(["", ", deadline_s: 7"]))
        return (f", on_failure: {policy}" if policy else "") + (f", retries: {retries}" if retries else "") + deadline

    lines = ["mission: m", "frame: hold", f"hold_s: {draw(st.integers(0, 20))}"]
    if policy := draw(POLICIES):
        lines.append(f"on_failure: {policy}")
    lines += [f"{key}: {draw(CONDITION_POLICIES)}" for key in ("on_link_loss", "on_low_battery", "on_pose_lost")]
    lines.append(f"on_restart: {draw(st.sampled_from(['continue', 'hold', 'land']))}")
    if draw(st.booleans()):
        lines.append("deadline_s: 60")
    policy = draw(POLICIES)
    return "\n".join(
        [
            *lines,
            "tasks:",
            "  up: {actions: {climb: {take_off: {height_m: 2}" + extras() + "}}}",
            "  work:",
            "    after: [up]",
            *([f"    on_failure: {policy}"] if policy else []),
            "    actions:",
            "      fly: {go_to: {position_m: [1, 1, 2]}" + extras() + "}",
            "      look: {record_images: {camera: ground, every_s: 1}, until: fly" + extras() + "}",
            "      rest: {wait: {duration_s: 3}, after: [fly]" + extras() + "}",
            "      on: {follow_waypoints: {waypoints_m: [[2, 2, 2]]}, after: [rest, look]" + extras() + "}",
            "  end: {after: [work], actions: {down: {land: {}" + extras() + "}}}",
        ]
    )


class Flights(RuleBasedStateMachine):
    """A rig (which watches the rules after every step) under everything that can happen to it."""

    rig: Rig

    @initialize(text=missions())
    def load(self, text: str) -> None:
        self.rig = Rig(PLATFORM, text)

    @rule(verb=VERBS, name=TARGETS)
    def steer(self, verb: str, name: str) -> None:
        before = self.rig.executor.snapshot(self.rig.now_s)
        try:
            self.rig.steer(verb, name)
        except Refused:
            assert self.rig.executor.snapshot(self.rig.now_s) == before

    @rule()
    def start(self) -> None:
        self.steer(verb="start", name="")

    @rule(seconds=st.sampled_from([0.1, 0.6, 2.5, 8.0, 25.0]))
    def wait(self, seconds: float) -> None:
        self.rig.pass_s(seconds)

    @precondition(lambda self: self.rig.under_way)
    @rule(
        data=st.data(),
        state=st.sampled_from([ActionState.DONE, ActionState.DONE, ActionState.FAILED, ActionState.ABORTED]),
    )
    def end(self, data: Any, state: ActionState) -> None:
        self.rig.report(data.draw(st.sampled_from(sorted(self.rig.under_way))), state, "because")

    @rule(is_airborne=st.booleans())
    def fly(self, is_airborne: bool) -> None:
        self.rig.fly(is_airborne)

    @rule(condition=st.sampled_from(list(PolicyCondition)), is_on=st.booleans())
    def arise(self, condition: PolicyCondition, is_on: bool) -> None:
        self.rig.arise(condition, is_on)

    @rule(has_control=st.booleans())
    def pilot(self, has_control: bool) -> None:
        self.rig.executor.pilot(has_control, "sticks", self.rig.now_s)
        self.rig.settle()

    @rule(names=st.lists(st.sampled_from(sorted(PLATFORM.capabilities)), max_size=3))
    def lack(self, names: list[str]) -> None:
        self.rig.executor.available(dict.fromkeys(names, ("pose",)), self.rig.now_s)
        self.rig.settle()

    @rule(component=st.sampled_from(["flight", "waypoints", "images"]))
    def fault(self, component: str) -> None:
        for action_id in [one for one, owner in self.rig.components.items() if owner == component]:
            self.rig.under_way.pop(action_id, None)
        self.rig.executor.component_failed(component, "faulty", self.rig.now_s)
        self.rig.settle()

    @rule(component=st.sampled_from(["flight", "waypoints", "images"]), reason=st.sampled_from(["", "busy"]))
    def refuse(self, component: str, reason: str) -> None:
        self.rig.refusing[component] = reason

    @rule(capability=st.sampled_from(["go_to", "record_images", "take_off"]))
    def command(self, capability: str) -> None:
        arguments: dict[str, dict[str, object]] = {
            "go_to": {"position_m": [1, 2, 3]},
            "record_images": {"camera": "ground", "every_s": 1},
            "take_off": {"height_m": 1},
        }
        rig = self.rig
        text = single_action(rig.executor.free_name(), capability, arguments[capability], None, "hold")
        with suppress(Refused):
            rig.executor.command(rig.read(text), rig.now_s)
        rig.settle()

    @rule(kind=st.sampled_from(["hold", "land"]))
    def emergency(self, kind: Any) -> None:
        self.rig.executor.emergency(kind, "ann", self.rig.now_s)
        self.rig.settle()

    @precondition(lambda self: self.rig.kept is not None)
    @rule(is_airborne=st.booleans())
    def restart(self, is_airborne: bool) -> None:
        refusing = self.rig.refusing
        self.rig = self.rig.restart(is_airborne)
        self.rig.refusing = refusing

    @invariant()
    def an_action_that_runs_is_in_a_component_s_hands(self) -> None:
        if not hasattr(self, "rig"):
            return
        board = self.rig.executor.board
        for program in board.programs.values():
            for run in program.actions():
                is_assigned = run.action_id in board.assignments.by_id
                if run.state is ActionState.RUNNING:
                    assert is_assigned or run.action.capability == "wait"
                assert not (is_assigned and run.state in ENDED)
        for action_id in self.rig.under_way:
            assert action_id in board.assignments.by_id, f"{action_id} was forgotten at its component"

    @invariant()
    def motion_is_never_without_an_owner_in_the_air(self) -> None:
        if hasattr(self, "rig"):
            board, grant = self.rig.executor.board, self.rig.grant
            if board.has_pilot:
                assert grant.action_id == ""
            elif board.is_airborne:
                assert grant.action_id

    @invariant()
    def a_mission_that_has_ended_has_nothing_going_on(self) -> None:
        if hasattr(self, "rig") and (mission := self.rig.executor.mission) is not None and mission.state in ENDED:
            assert all(item.state in ENDED for item in mission.items())

    def teardown(self) -> None:
        """Whatever has happened: an abort, answers and time bring everything to its end."""
        if not hasattr(self, "rig"):
            return
        rig = self.rig
        rig.refusing.clear()
        rig.executor.available({}, rig.now_s)
        if rig.executor.board.has_pilot:
            rig.pass_s(1)
            try:
                rig.steer("resume")
            except Refused:
                assert rig.state() == "paused"
        for item in [rig.executor.mission, *rig.executor.board.programs.values()]:
            if item is not None and item.is_open:
                rig.steer("abort", "" if item.is_mission else next(iter(item.tasks)))
        for _ in range(6):
            for action_id in list(rig.under_way):
                rig.report(action_id, ActionState.DONE)
            rig.pass_s(25)
        assert rig.executor.mission is None or rig.executor.mission.state in (*ENDED, ActionState.WAITING)
        assert rig.under_way == {}
        assert rig.executor.policy in ("", "hold", "pilot")


TestFlights = Flights.TestCase
TestFlights.settings = settings(max_examples=40, stateful_step_count=25, suppress_health_check=list(HealthCheck))
