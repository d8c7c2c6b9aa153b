"""Missions, tasks and actions while they run: states, attempts and times. They move along the table of states only."""

from collections.abc import Iterator
from math import inf
from typing import Final

from msgspec import structs

from gloc3.mission.executing.snapshot import ItemSnapshot, ProgramSnapshot
from gloc3.mission.model.model import Action, ItemFile, Mission, Task, attempts
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import OURS, TABLE, ActionState, StateTrigger, transition
from gloc3.platform.platform import Capability

MISSION: Final = "mission"
"""The name of the program that is the loaded mission."""
COMMAND: Final = "command "
"""What the name of a single command's program begins with; its first task's name follows, which has no space in it."""

_OVER: Final = (ActionState.DONE, ActionState.SKIPPED, ActionState.ABORTED)


class MissionItem:
    """Common part of a mission, a task and an action."""

    level: str = ""

    def __init__(self, target: str, options: ItemFile, deadline_s: float | None) -> None:
        self.target: Final = target
        self.options: Final = options
        self.deadline_s: Final = deadline_s
        self.state = ActionState.WAITING
        self.reason = ""
        self.starts = 0
        """Number of starts since an operator's last retry."""
        self.is_settled = False
        """Failed, and continued by the policy `continue`."""
        self.paused_by = ""
        """Level whose pause it is in."""
        self._ran_s = 0.0
        self._since_s: float | None = None
        self._waited_s = 0.0
        """For its guard, before it began."""
        self._waits_since_s: float | None = None

    def __repr__(self) -> str:
        return f"<{self.level} {self.target} {self.state}>"

    @property
    def has_ended(self) -> bool:
        """Whether items after it may start."""
        return self.state in _OVER or (self.state is ActionState.FAILED and self.is_settled)

    @property
    def is_open(self) -> bool:
        """Whether it has started and not ended."""
        return self.state in (ActionState.RUNNING, ActionState.PAUSED)

    @property
    def accepted(self) -> tuple[StateTrigger, ...]:
        """What an operator may do to it in its state."""
        return tuple(trigger for trigger in TABLE[self.state] if trigger not in OURS)

    @property
    def has_attempts_left(self) -> bool:
        """Whether a failure leads to another attempt."""
        return self.starts < attempts(self.options)

    @property
    def policy(self) -> Policy | None:
        """What it says itself about its failure, its attempts being used up."""
        return None if self.options.on_failure is Policy.RETRY else self.options.on_failure

    def ran_s(self, now_s: float) -> float:
        """How long it has been running, pauses left out."""
        return self._ran_s + (now_s - self._since_s if self._since_s is not None else 0.0)

    def reaches_s(self, duration_s: float | None) -> float:
        """When it will have been running for `duration_s`; infinite while it does not run."""
        if duration_s is None or self._since_s is None:
            return inf
        return self._since_s + duration_s - self._ran_s

    def due_s(self) -> float:
        """When its deadline passes if it continues to run; waiting for its guard counts."""
        return self.reaches_s(self.deadline_s if self.deadline_s is None else self.deadline_s - self._waited_s)

    def waited_s(self, now_s: float) -> float:
        """How long it has been waiting for its guard, pauses left out."""
        return self._waited_s + (now_s - self._waits_since_s if self._waits_since_s is not None else 0.0)

    def await_permission(self, now_s: float, reason: str) -> None:
        """Its turn has come, and its guard does not let it begin yet."""
        self.reason = reason
        if self._waits_since_s is None:
            self._waits_since_s = now_s

    def rest(self, now_s: float) -> None:
        """It waits for its guard no more, or not now."""
        self._waited_s, self._waits_since_s = self.waited_s(now_s), None

    def wait_limit_s(self, unknown_s: float) -> float:
        """Longest wait for its guard; `unknown_s` where it waits only for a quantity that is not measured."""
        is_waiting = self.options.otherwise == "wait" and self.deadline_s is not None
        return self.deadline_s if is_waiting and self.deadline_s is not None else unknown_s

    def gives_up_s(self, unknown_s: float) -> float:
        """When it has waited for its guard that long; infinite where it does not wait."""
        if self._waits_since_s is None or self.state is not ActionState.WAITING:
            return inf
        return self._waits_since_s + self.wait_limit_s(unknown_s) - self._waited_s

    def move(self, trigger: StateTrigger, now_s: float, reason: str = "") -> None:
        """Changes the state by the table.

        Raises:
            Refused: the table has no such row.
        """
        to = transition(self.state, trigger)
        self._ran_s = 0.0 if to is ActionState.WAITING else self.ran_s(now_s)
        self._since_s = now_s if to is ActionState.RUNNING else None
        if to is ActionState.WAITING:
            self._waited_s, self._waits_since_s = 0.0, None
        self.state, self.reason = to, reason
        self.paused_by = ""
        if trigger is StateTrigger.START:
            self.starts += 1

    def snapshot(self, now_s: float) -> ItemSnapshot:
        """What is kept of it."""
        return ItemSnapshot(
            state=self.state,
            reason=self.reason,
            starts=self.starts,
            ran_s=self.ran_s(now_s),
            is_settled=self.is_settled,
            paused_by=self.paused_by,
            waited_s=self.waited_s(now_s),
        )

    def restore(self, kept: ItemSnapshot, now_s: float) -> None:
        """Restores the state from a snapshot."""
        self.state, self.reason, self.starts = kept.state, kept.reason, kept.starts
        self.is_settled, self.paused_by, self._ran_s = kept.is_settled, kept.paused_by, kept.ran_s
        self._waited_s = kept.waited_s
        self._since_s = now_s if kept.state is ActionState.RUNNING else None


class ActionRun(MissionItem):
    """An action of a program."""

    level = "action"

    def __init__(self, task: "TaskRun", action: Action, row: Capability) -> None:
        super().__init__(f"{task.target}.{action.name}", action.options, action.options.deadline_s)
        self.task: Final = task
        self.action: Final = action
        self.row: Final = row
        self.until: Final = action.options.until
        self.progress = 0.0
        self.action_id = ""
        """The id under which a component is at it; empty where none is."""
        self.unavailable_since_s: float | None = None

    @property
    def is_motion(self) -> bool:
        """Whether it moves the vehicle."""
        return "motion" in self.row.claims

    def reset(self) -> None:
        """It is to be done from its beginning."""
        self.starts, self.progress, self.is_settled, self.unavailable_since_s = 0, 0.0, False, None

    def snapshot(self, now_s: float) -> ItemSnapshot:
        """What is kept of it."""
        return structs.replace(super().snapshot(now_s), progress=self.progress, is_planned=self.action.is_planned)

    def restore(self, kept: ItemSnapshot, now_s: float) -> None:
        """Restores the state from a snapshot."""
        super().restore(kept, now_s)
        self.progress = kept.progress


class TaskRun(MissionItem):
    """A task of a program."""

    level = "task"

    def __init__(self, program: "MissionProgram", task: Task) -> None:
        super().__init__(task.name, task.options, task.options.deadline_s)
        self.program: Final = program
        self.elsewhere: Final = task.options.performer if task.is_elsewhere else ""
        """The other platform that performs it; empty for this platform's own."""
        self.actions: Final[dict[str, ActionRun]] = {
            action.name: ActionRun(self, action, program.rows[action.ability]) for action in task.actions.values()
        }
        self.blemish = ""
        """Reason for which it will end as failed, although it continues."""
        self.repeat: Final = task.options.repeat
        self.repetition = 0
        """Current repetition, from 1; 0 where it is not repeated, or has not started."""
        self.unknown_since_s: float | None = None
        """Since when its repetition depends on a quantity that is not measured at the moment."""

    def move(self, trigger: StateTrigger, now_s: float, reason: str = "") -> None:
        """Changes the state by the table."""
        super().move(trigger, now_s, reason)
        self.unknown_since_s = None
        if trigger is StateTrigger.START and self.repeat is not None:
            self.repetition = max(self.repetition, 1)

    def snapshot(self, now_s: float) -> ItemSnapshot:
        """What is kept of it."""
        return structs.replace(super().snapshot(now_s), repetition=self.repetition, blemish=self.blemish)

    def restore(self, kept: ItemSnapshot, now_s: float) -> None:
        """Restores the state from a snapshot."""
        super().restore(kept, now_s)
        self.repetition, self.blemish = kept.repetition, kept.blemish

    def adopt(self, state: ActionState, reason: str, *, is_settled: bool) -> bool:
        """Adopts the reported state of another platform's task; one that was skipped here, with a reason, stays skipped.

        Returns:
            Whether anything has changed.
        """
        is_left_out = self.state is ActionState.SKIPPED and self.reason != ""
        if is_left_out or (self.state, self.is_settled) == (state, is_settled):
            return False
        self.state, self.reason, self.is_settled = state, reason, is_settled
        return True


class MissionProgram(MissionItem):
    """The loaded mission, or a single requested task or action."""

    level = "mission"

    def __init__(self, name: str, mission: Mission, rows: dict[str, Capability]) -> None:
        super().__init__(name, ItemFile(), mission.deadline_s)
        self.name: Final = name
        self.mission: Final = mission
        self.rows: Final = rows
        self.tasks: Final[dict[str, TaskRun]] = {task.name: TaskRun(self, task) for task in mission.tasks.values()}
        self.joined: set[str] = set()
        """The other platforms that were seen in it before its end there, since it was loaded."""

    def snapshot(self, now_s: float) -> ItemSnapshot:
        """What is kept of it."""
        return structs.replace(super().snapshot(now_s), joined=sorted(self.joined))

    def restore(self, kept: ItemSnapshot, now_s: float) -> None:
        """Restores the state from a snapshot."""
        super().restore(kept, now_s)
        self.joined = set(kept.joined)

    @property
    def is_mission(self) -> bool:
        """Whether it is the loaded mission, whose policies apply."""
        return self.name == MISSION

    @property
    def own_tasks(self) -> list[TaskRun]:
        """The tasks that this platform performs."""
        return [task for task in self.tasks.values() if not task.elsewhere]

    @property
    def others(self) -> tuple[str, ...]:
        """The other platforms that have a part in it."""
        return tuple(dict.fromkeys(task.elsewhere for task in self.tasks.values() if task.elsewhere))

    def awaited(self) -> dict[str, list[TaskRun]]:
        """By other platform: its tasks that one of this platform's waits for, with no other own task left before it."""
        found: dict[str, list[TaskRun]] = {}
        judged: dict[str, bool] = {}
        for task in self.own_tasks:
            if task.state is ActionState.WAITING and not self._waits_for_us(task, judged):
                for one in self._left(task):
                    found.setdefault(one.elsewhere, []).append(one)
        return found

    def _left(self, task: TaskRun) -> list[TaskRun]:
        """What a task comes after, and has not ended."""
        return [one for name in task.options.after if not (one := self.tasks[name]).has_ended]

    def _waits_for_us(self, task: TaskRun, judged: dict[str, bool]) -> bool:
        if task.target not in judged:
            judged[task.target] = any(not one.elsewhere or self._waits_for_us(one, judged) for one in self._left(task))
        return judged[task.target]

    def actions(self) -> Iterator[ActionRun]:
        """All actions, in the order of the file."""
        for task in self.tasks.values():
            yield from task.actions.values()

    def items(self) -> Iterator[TaskRun | ActionRun]:
        """All tasks, each followed by its actions."""
        for task in self.tasks.values():
            yield task
            yield from task.actions.values()

    def find(self, target: str) -> "TaskRun | ActionRun | None":
        """The task or `TASK.ACTION` of that name."""
        task_name, _, action_name = target.partition(".")
        task = self.tasks.get(task_name)
        return task.actions.get(action_name) if task is not None and action_name else task

    def keep(self, now_s: float) -> ProgramSnapshot:
        """What is kept of it and of all that is in it."""
        return ProgramSnapshot(
            name=self.name,
            text=self.mission.text,
            own=self.snapshot(now_s),
            items={item.target: item.snapshot(now_s) for item in self.items()},
        )
