"""Goes on after a pause: what was paused together goes on together, from where it was."""

from gloc3.errors import Refused
from gloc3.messages import Severity
from gloc3.mission import manoeuvres
from gloc3.mission.arguments import SetOff
from gloc3.mission.board import Board
from gloc3.mission.failures import retry
from gloc3.mission.flow import go_on_after_pause
from gloc3.mission.items import ActionRun, Item, Program, TaskRun
from gloc3.mission.policy import Policy
from gloc3.mission.states import ActionState, Trigger


def resume_mission(board: Board, now_s: float) -> None:
    """Has the mission go on after a contingency; where it cannot, it holds."""
    mission = board.mission
    assert mission is not None
    try:
        check_resumable(board, mission)
    except Refused as refusal:
        board.tell(Severity.WARNING, f"the mission does not go on: {refusal}")
        manoeuvres.apply(board, Policy.HOLD, str(refusal), now_s)
        return
    go_on(board, mission, now_s)


def _paused_in(item: Item) -> list[ActionRun]:
    """The actions that a resume of the item would resume."""
    runs = item.actions() if isinstance(item, Program) else item.actions.values() if isinstance(item, TaskRun) else ()
    found = [run for run in runs if run.state is ActionState.PAUSED and run.paused_by == item.paused_by]
    return [item] if isinstance(item, ActionRun) else found


def check_resumable(board: Board, item: Item) -> None:
    """Whether all that a resume would resume can go on now.

    Raises:
        Refused: with the reason.
    """
    for run in _paused_in(item):
        holder = board.assignments.holder(run.row)
        if holder is not None:
            raise Refused(f"{run.target} needs {run.row.claims[0]}, claimed by {holder.label}; pause or abort it first")
        if run.is_motion and not board.is_airborne and not isinstance(run.action.order, SetOff):
            raise Refused(f"the vehicle is on the ground, and {run.target} was paused in the air; abort it")
        if run.action.ability in board.missing:
            lacking = ", ".join(board.missing[run.action.ability])
            raise Refused(f"{run.action.ability} is not available: it lacks {lacking}")


def go_on(board: Board, item: Item, now_s: float) -> None:
    """Resumes an item, what was paused with it, and tries again what has failed in it."""
    by = item.paused_by
    runs = _paused_in(item)
    if isinstance(item, Program):
        board.move(item, Trigger.RESUME, now_s)
        for task in item.own_tasks:
            if task.state is ActionState.PAUSED and task.paused_by == by:
                board.move(task, Trigger.RESUME, now_s)
            elif task.state is ActionState.FAILED and not task.is_settled:
                retry(board, task, now_s)
    elif isinstance(item, TaskRun):
        board.move(item, Trigger.RESUME, now_s)
    for run in runs:
        go_on_after_pause(board, run, now_s)
    if isinstance(item, Program | TaskRun):
        waiting = item.actions() if isinstance(item, Program) else iter(item.actions.values())
        for run in waiting:
            if run.state is ActionState.FAILED and not run.is_settled:
                retry(board, run, now_s)
