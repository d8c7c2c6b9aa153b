"""The executor's knowledge at one moment: programs, assignments, the vehicle, conditions, and the policy under way."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from math import inf
from typing import Final

from gloc3.errors import Misuse, Refused, nearest
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import Cause
from gloc3.mission.executing.assignments import Assignment, AssignmentPhase, Assignments
from gloc3.mission.executing.items import MISSION, ActionRun, MissionItem, MissionProgram, TaskRun
from gloc3.mission.executing.requests import MissionEvent
from gloc3.mission.executing.snapshot import PlannedSilence, Snapshot
from gloc3.mission.model.abilities import abilities
from gloc3.mission.model.conditions import Readings
from gloc3.mission.model.model import Contingency, Mission, Policies
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState, StateTrigger
from gloc3.platform.platform import Capability, Platform

BY_OPERATOR: Final = "by an operator"
"""Reason of what an operator has started, skipped or aborted."""


class PolicyCondition(StrEnum):
    """Conditions that trigger a policy, whatever the vehicle is doing."""

    LINK_LOST = "link lost"
    OVERDUE = "overdue"
    """A planned silence has lasted longer than stated."""
    LOW_BATTERY = "low battery"
    POSE_LOST = "pose lost"
    FENCE_BREACHED = "fence breached"
    OBSTACLE = "obstacle"
    """In the path of the action that moves the vehicle, for too long."""
    PLATFORM_LOST = "platform lost"
    """Another platform of the mission on whose tasks this one waits."""

    @property
    def cause(self) -> str:
        """Name of what it follows from, which stations may know already."""
        return _CAUSES.get(self, self.value)


_CAUSES: Final = {
    PolicyCondition.LINK_LOST: Cause.LINK,
    PolicyCondition.OVERDUE: Cause.LINK,
    PolicyCondition.LOW_BATTERY: Cause.BATTERY,
    PolicyCondition.POSE_LOST: Cause.POSITION,
}

STAYS_DOWN_S: Final = 10.0
"""A take-off that has ended or is paused, and has not lifted the vehicle after so long, does not any more."""
UNATTENDED_S: Final = 30.0
"""A pilot who has control and of whom nothing is heard for so long has left the vehicle to the policies (DESIGN §7)."""
SAFETY: Final = frozenset(
    {PolicyCondition.LINK_LOST, PolicyCondition.LOW_BATTERY, PolicyCondition.POSE_LOST, PolicyCondition.FENCE_BREACHED}
)
"""Those that are answered also where a pilot has control of whom nothing is heard any more."""


class PolicyManoeuvre:
    """A policy that is being carried out."""

    __slots__ = (
        "again_s",
        "assignment",
        "cause",
        "contingency",
        "land_at_s",
        "policy",
        "problem",
        "program",
    )

    def __init__(self, policy: Policy, cause: str) -> None:
        self.policy = policy
        """`hold`, `return` or `land`."""
        self.cause = cause
        self.land_at_s: float | None = None
        """With `hold`: when it ends in a landing unless an operator acts; None for never."""
        self.assignment: Assignment | None = None
        """The action under way for it."""
        self.again_s: float | None = None
        """When its action is tried again."""
        self.problem = ""
        """Why it could not be started the last time; reported once."""
        self.contingency: Contingency | None = None
        """The task that runs in its place first."""
        self.program: MissionProgram | None = None
        """With a contingency: its run."""


class OtherPlatform:
    """State of another platform of the mission."""

    __slots__ = ("earlier", "is_lost", "received_s", "state")

    def __init__(self, received_s: float) -> None:
        self.is_lost = False
        """It is waited for and lost, and the policy for this has been carried out."""
        self.received_s = received_s
        """Time of its last report; the start of the mission until then."""
        self.state: ActionState | None = None
        """Of the mission there; None before the first report."""
        self.earlier: ActionState | None = None
        """How an earlier run of the mission ended there, while only this is reported."""


class Missing(dict[str, tuple[str, ...]]):
    """Unavailable capabilities, with what each lacks and since when."""

    def __init__(self) -> None:
        super().__init__()
        self.since_s: Final[dict[str, float]] = {}

    def replace(self, missing: Mapping[str, tuple[str, ...]], now_s: float) -> None:
        """Sets the unavailable capabilities; all others are available."""
        for name in [name for name in self if name not in missing]:
            del self[name], self.since_s[name]
        self.add(missing, now_s)

    def add(self, missing: Mapping[str, tuple[str, ...]], now_s: float) -> None:
        """Adds unavailable capabilities."""
        self.update(missing)
        for name in missing:
            self.since_s.setdefault(name, now_s)

    def words(self, capability: str) -> str:
        """What a capability lacks."""
        return ", ".join(self.get(capability, ()))


class AirState:
    """State in the air or on the ground: as it is reported, and as actions have ended since."""

    __slots__ = ("_idle_since_s", "has_landed", "is_reported", "is_taking_off")

    def __init__(self) -> None:
        self.is_reported = False
        self.is_taking_off = False
        """A take-off has started, and no report confirms yet that the vehicle is in the air."""
        self.has_landed = False
        """An action landed the vehicle, whatever the last report says."""
        self._idle_since_s: float | None = None
        """With `is_taking_off`: since when the vehicle is reported on the ground and no action moves it."""

    @property
    def is_airborne(self) -> bool:
        """Whether it is."""
        return (self.is_reported or self.is_taking_off) and not self.has_landed

    def depart(self) -> None:
        """A take-off starts, or goes on."""
        self.is_taking_off |= not self.is_airborne
        self.has_landed, self._idle_since_s = False, None

    def land(self) -> None:
        """An action has landed the vehicle."""
        self.is_taking_off, self.has_landed = False, True

    def stays_down(self, *, is_moved: bool, now_s: float) -> bool:
        """Whether a take-off that has ended or is paused will not come any more.

        Args:
            is_moved: whether an action moves the vehicle.
            now_s: the time, at which the vehicle is reported on the ground.
        """
        if is_moved or not self.is_taking_off:
            self._idle_since_s = None
        elif self._idle_since_s is None:
            self._idle_since_s = now_s
        elif now_s >= self._idle_since_s + STAYS_DOWN_S:
            self.is_taking_off = False
            return True
        return False


class Board:
    """The state that the executor's parts share."""

    def __init__(self, platform: Platform) -> None:
        self.rows: Final[dict[str, Capability]] = dict(abilities(platform))
        self.assignments: Final = Assignments(platform.capabilities.get("hold"))
        self.programs: Final[dict[str, MissionProgram]] = {}
        """The loaded mission, and single tasks and actions, by name."""
        self.policies = Policies()
        """Those of the last mission that was started."""
        self.manoeuvre: PolicyManoeuvre | None = None
        self.has_pilot = False
        """A pilot has control, and no operator has resumed since."""
        self.taken_over_s = -inf
        """When a pilot, or the autopilot's failsafe, has last taken over."""
        self.is_failsafe = False
        """With `has_pilot`: it is the autopilot's failsafe that has control."""
        self.is_operator = False
        """With `has_pilot`: an operator has commanded the autopilot itself."""
        self.is_taking_back = False
        """An operator has just resumed; the driver has to be notified."""
        self.conditions: Final[dict[PolicyCondition, str]] = {}
        """Those that hold, with the reason."""
        self.unanswered: Final[dict[PolicyCondition, str]] = {}
        """Those that arose while a pilot had control."""
        self.lost: Final[dict[str, tuple[Policy, str]]] = {}
        """Components lost for good while a pilot had control: the policy of their row, and the reason."""
        self.others: dict[str, OtherPlatform] = {}
        """The other platforms of the running mission."""
        self.silence: PlannedSilence | None = None
        """The planned silence under way; None without one."""
        self.kept_s = float("-inf")
        """When the silence was last written to disk."""
        self.missing: Final = Missing()
        self.readings: Readings = {}
        """What is measured now."""
        self.blocked_since_s: float | None = None
        """When the obstacle appeared in the path of the action that moves the vehicle; None without one."""
        self.air: Final = AirState()
        self.reported: list[MissionEvent] = []
        self._cause = ""
        """What reports follow from now."""
        self.is_changed = False
        """Something that must survive the process has changed."""

    @property
    def mission(self) -> MissionProgram | None:
        """The loaded mission."""
        return self.programs.get(MISSION)

    @property
    def is_airborne(self) -> bool:
        """Whether the vehicle is in the air."""
        return self.air.is_airborne

    @property
    def controller(self) -> str:
        """Who has control in place of the mission."""
        return {"failsafe": "the autopilot's failsafe", "operator": "an operator"}.get(self.in_control, "the pilot")

    @property
    def in_control(self) -> str:
        """With `has_pilot`: `pilot`, `operator` or `failsafe`."""
        return "failsafe" if self.is_failsafe else "operator" if self.is_operator else "pilot"

    def find(self, target: str) -> MissionItem:
        """The item that an operator names: empty for the mission, `TASK`, or `TASK.ACTION`; of two the one under way.

        Raises:
            Refused: there is none.
        """
        if not target:
            if self.mission is None:
                raise Refused("no mission is loaded")
            return self.mission
        for program in sorted(self.programs.values(), key=lambda program: not program.is_open):
            if (item := program.find(target)) is not None:
                return item
        known = [item.target for program in self.programs.values() for item in program.items()]
        raise Refused(f"there is no {target!r}; {nearest(target, known)}")

    def users(self, component: str, provides: tuple[str, ...]) -> list[Assignment]:
        """Running assignments that need a component.

        Args:
            component: its name.
            provides: the topics that only it publishes, and the component that it substitutes.
        """
        names = {component, *provides}
        return [
            assignment
            for assignment in self.assignments.by_id.values()
            if assignment.phase is not AssignmentPhase.PAUSED
            and (assignment.component in names or names & {*self.rows[assignment.capability].needs})
        ]

    def program(self, name: str, mission: Mission) -> MissionProgram:
        """Creates a program and adds it to the board."""
        missing = [action.ability for action in mission.actions().values() if action.ability not in self.rows]
        if missing:
            raise Misuse(f"the mission was not checked: no capability {missing[0]!r}")
        program = MissionProgram(name, mission, self.rows)
        self.programs[name] = program
        self.is_changed = True
        return program

    def move(self, item: MissionItem, trigger: StateTrigger, now_s: float, reason: str = "") -> None:
        """Moves an item to its next state and reports it.

        Raises:
            Refused: the table has no such row; nothing has changed.
        """
        item.move(trigger, now_s, reason)
        self.is_changed = True
        if trigger is StateTrigger.START and item.starts == 1 and item.options.silence is not None:
            self._expect_silence(item.target, item.options.silence.expected_s, now_s)
        severity = Severity.WARNING if item.state is ActionState.FAILED else Severity.INFO
        label = "mission" if isinstance(item, MissionProgram) and item.is_mission else item.target
        if not isinstance(item, MissionProgram) or item.is_mission:
            self.report(severity, f"{label} {item.state}" + (f": {reason}" if reason else ""))

    def _expect_silence(self, target: str, expected_s: float, now_s: float) -> None:
        """Starts the planned silence of a task or action; of several, the longest applies."""
        if self.silence is None or self.silence.until_s < now_s + expected_s:
            self.silence = PlannedSilence(target=target, began_s=now_s, until_s=now_s + expected_s)
            self.report(Severity.NOTICE, f"{target} starts a planned silence of {expected_s:g} s")

    def report(self, severity: Severity, text: str) -> None:
        """Notes something for the operators and the log."""
        self.reported.append(MissionEvent(severity=severity, text=text, cause=self._cause))

    @contextmanager
    def because(self, cause: str) -> Iterator[None]:
        """Reports within follow from one cause; within another one's they follow from that."""
        before, self._cause = self._cause, self._cause or cause
        try:
            yield
        finally:
            self._cause = before

    def assignment(self, run: ActionRun) -> Assignment | None:
        """The component's end of an action."""
        return self.assignments.by_id.get(run.action_id)

    def release(self, run: ActionRun, *, is_over: bool = False) -> None:
        """Takes an action from its component."""
        assignment = self.assignment(run)
        if assignment is not None:
            self.assignments.drop(assignment, is_over=is_over)

    def end(self, item: TaskRun | ActionRun, trigger: StateTrigger, now_s: float, reason: str = "") -> None:
        """Skips or aborts an item and all in it that has not ended."""
        if isinstance(item, TaskRun):
            for run in item.actions.values():
                if not run.has_ended:
                    self.end(run, trigger, now_s, reason)
        else:
            self.release(item)
        if item.state is ActionState.FAILED and trigger is StateTrigger.ABORT:
            item.is_settled = True  # it stays failed
        elif not item.has_ended:
            self.move(item, trigger, now_s, reason)

    def end_all(self, program: MissionProgram, trigger: StateTrigger, now_s: float, reason: str = "") -> None:
        """Skips or aborts all items of this platform in a program that has not ended, but not the program itself."""
        for task in program.own_tasks:
            self.end(task, trigger, now_s, reason)

    def halt(self, item: MissionItem, by: str, now_s: float, reason: str = "") -> None:
        """Pauses a running item and everything in it; `by` is the level that was paused."""
        if isinstance(item, MissionProgram):
            for task in item.own_tasks:
                self.halt(task, by, now_s)
        elif isinstance(item, TaskRun):
            for run in item.actions.values():
                self.halt(run, by, now_s)
        elif isinstance(item, ActionRun):
            item.unavailable_since_s = None
        item.rest(now_s)
        if isinstance(item, ActionRun):
            assignment = self.assignment(item)
            if assignment is not None and item.state is ActionState.RUNNING:
                self.assignments.pause(assignment, now_s)
        if item.state is ActionState.RUNNING:
            self.move(item, StateTrigger.PAUSE, now_s, reason)
            item.paused_by = by

    def snapshot(self, now_s: float) -> Snapshot:
        """What must survive the process."""
        return Snapshot(
            count=self.assignments.count,
            programs=[program.keep(now_s) for program in self.programs.values()],
            policy=self.manoeuvre.policy if self.manoeuvre is not None else None,
            cause=self.manoeuvre.cause if self.manoeuvre is not None else "",
            land_at_s=self.manoeuvre.land_at_s if self.manoeuvre is not None else None,
            has_pilot=self.has_pilot,
            lost=dict(self.lost),
            silence=self.silence,
            contingency=self.manoeuvre.contingency if self.manoeuvre is not None else None,
            kept_s=now_s,
        )
