"""Guards and loops while a mission runs: whether a task or an action may begin, and whether a task is done once more."""

from enum import Enum, auto
from typing import Final

from gloc3.messages import Severity
from gloc3.mission.board import Board
from gloc3.mission.failures import fail_action, fail_task
from gloc3.mission.items import ActionRun, TaskRun
from gloc3.mission.states import ActionState, Trigger

PATIENCE_S: Final = 2.0
"""So long a guard waits for what is not measured at the moment; then it counts as not met."""


class Leave(Enum):
    """What a guard says."""

    BEGIN = auto()
    WAIT = auto()
    ENDED = auto()
    """The item was skipped, or has failed."""


def leave(board: Board, item: TaskRun | ActionRun, now_s: float) -> Leave:
    """Whether an item whose turn it is may begin; where it may not, it is skipped, waits or fails as its guard says."""
    guard = item.options.when
    if guard is None:
        return Leave.BEGIN
    holds = guard.holds(board.readings)
    if holds:
        item.rest(now_s)
        return Leave.BEGIN
    is_waited_for = item.options.otherwise == "wait" or holds is None
    if is_waited_for and now_s < item.gives_up_s(PATIENCE_S):
        item.await_leave(now_s, f"waits for {guard}")
        return Leave.WAIT
    item.rest(now_s)
    lacking = f"{guard} is not known" if holds is None else f"not {guard}"
    if item.options.otherwise == "skip":
        board.end(item, Trigger.SKIP, now_s, lacking)
        return Leave.ENDED
    board.move(item, Trigger.START, now_s)
    reason = lacking if item.options.otherwise == "fail" else f"deadline passed: it waited for {guard}"
    if isinstance(item, TaskRun):
        fail_task(board, item, reason, now_s)
    else:
        fail_action(board, item, reason, now_s)
    return Leave.ENDED


def due_s(item: TaskRun | ActionRun) -> float:
    """When an item that waits for its guard gives up; infinite where it does not wait."""
    return item.gives_up_s(PATIENCE_S)


def is_to_repeat(board: Board, task: TaskRun) -> bool:
    """Whether a task whose actions have all ended is to be done once more."""
    repeat = task.repeat if task.is_open else None
    if repeat is None or task.repetition >= repeat.times:
        return False
    return repeat.until is None or not repeat.until.holds(board.readings)


def repeat(board: Board, task: TaskRun, now_s: float) -> bool:
    """Has all actions of a task wait for their turn again; whether that was done: a paused task does not begin anew."""
    assert task.repeat is not None
    if task.state is not ActionState.RUNNING:
        return False
    task.repetition += 1
    for run in task.actions.values():
        if run.state is not ActionState.ABORTED:
            run.move(Trigger.RETRY if run.state is ActionState.FAILED else Trigger.REPEAT, now_s)
            run.forget()
    board.is_changed = True
    board.tell(Severity.INFO, f"{task.target}: {task.repetition} of {task.repeat.times}")
    return any(run.state is ActionState.WAITING for run in task.actions.values())
