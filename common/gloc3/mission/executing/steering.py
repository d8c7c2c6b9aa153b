"""Operators' commands that need more than a move: what must hold before a resume, and what follows an abort."""

from typing import Final

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3.mission.executing import manoeuvres, reactions, takeovers
from gloc3.mission.executing.board import BY_OPERATOR, Board
from gloc3.mission.executing.failures import reopen, retry
from gloc3.mission.executing.flow import busy, go_on_after_pause
from gloc3.mission.executing.items import ActionRun, MissionItem, MissionProgram, TaskRun
from gloc3.mission.model.arguments import LandOrder
from gloc3.mission.model.policy import MANOEUVRES, SEVERITY, Policy, resolved
from gloc3.mission.model.states import ActionState, StateTrigger

UNSEEN_S: Final = 1.0
"""So long after a pilot has taken over an operator who says resume cannot have seen it."""


def take_back(board: Board, now_s: float) -> None:
    """Returns control to the mission when an operator resumes after a pilot.

    Raises:
        Refused: it cannot be resumed now, or the operator cannot know of the pilot yet; nothing has changed.
    """
    mission = board.mission
    if now_s - board.taken_over_s < UNSEEN_S and not (board.is_failsafe or board.is_operator):
        raise Refused("a pilot has taken over within the last second; resume again to take the vehicle back")
    if mission is not None and mission.state is ActionState.PAUSED:
        check_resumable(board, mission)
    takeovers.take_back(board)
    if mission is not None and mission.state is ActionState.PAUSED:
        go_on(board, mission, now_s)
    reactions.answer_waiting(board, now_s)


def resume(board: Board, item: MissionItem, now_s: float) -> None:
    """Resumes a paused item.

    Raises:
        Refused: it cannot be resumed now; nothing has changed.
    """
    if board.has_pilot:
        raise Refused(f"{board.controller} has control; resume the mission to take it back")
    for parent in _parents(item):
        if parent.state is ActionState.PAUSED:
            raise Refused(f"the {parent.level} is paused; resume it first")
    manoeuvre = board.manoeuvre
    if manoeuvre is not None and manoeuvre.contingency is not None:
        if item not in (manoeuvre.program, *(manoeuvre.program.items() if manoeuvre.program is not None else ())):
            raise Refused(busy(manoeuvre))
    elif manoeuvre is not None and manoeuvre.policy is not Policy.HOLD:
        raise Refused(f"the policy {manoeuvre.policy} is being carried out ({manoeuvre.cause})")
    check_resumable(board, item)
    manoeuvres.dismiss(board, now_s)
    go_on(board, item, now_s)


def try_again(board: Board, item: MissionItem, now_s: float) -> None:
    """Retries a failed task or action.

    Raises:
        Refused: it cannot; nothing has changed.
    """
    if not isinstance(item, TaskRun | ActionRun):
        raise Refused("a mission that has ended cannot be retried; load it again")
    if item.is_settled:
        raise Refused(f"the mission has gone on without {item.target}")
    manoeuvres.dismiss(board, now_s)
    retry(board, item, now_s)


def _parents(item: MissionItem) -> list[MissionItem]:
    match item:
        case ActionRun():
            return [item.task.program, item.task]
        case TaskRun():
            return [item.program]
    return []


def end(board: Board, item: MissionItem, trigger: StateTrigger, now_s: float) -> None:
    """Skips or aborts; an abort is followed by the mission's `on_failure`."""
    manoeuvres.dismiss(board, now_s)
    if isinstance(item, MissionProgram):
        was_open = item.is_open
        board.end_all(item, trigger, now_s, BY_OPERATOR)
        board.move(item, trigger, now_s, BY_OPERATOR)
        if trigger is StateTrigger.ABORT and was_open:
            _follow_abort(board, item, now_s, is_whole=True)
        return
    assert isinstance(item, TaskRun | ActionRun)
    program = item.program if isinstance(item, TaskRun) else item.task.program
    board.end(item, trigger, now_s, BY_OPERATOR)
    if trigger is StateTrigger.ABORT and program.is_open:
        _follow_abort(board, program, now_s, is_whole=False)
    elif isinstance(item, ActionRun):
        reopen(board, item.task, now_s)


def _follow_abort(board: Board, program: MissionProgram, now_s: float, *, is_whole: bool) -> None:
    on_failure = program.mission.policies.on_failure
    if board.has_pilot or not (is_whole or on_failure in MANOEUVRES):
        return
    policy = resolved(Policy.ABORT, on_failure)
    current = board.manoeuvre
    if is_whole and current is not None and current.contingency is not None:
        policy = max(policy, current.policy, key=lambda one: SEVERITY[one])  # what would have followed it
        manoeuvres.stop(board, now_s)
    manoeuvres.apply(board, policy, f"abort {BY_OPERATOR}", now_s, StateTrigger.ABORT)


def resume_mission(board: Board, now_s: float) -> None:
    """Resumes the mission after a contingency, or holds if it cannot continue."""
    mission = board.mission
    assert mission is not None
    try:
        check_resumable(board, mission)
    except Refused as refusal:
        board.report(Severity.WARNING, f"the mission cannot continue: {refusal}")
        manoeuvres.apply(board, Policy.HOLD, str(refusal), now_s)
        return
    go_on(board, mission, now_s)


def _paused_in(item: MissionItem) -> list[ActionRun]:
    """The actions that a resume of the item would resume."""
    runs = (
        item.actions()
        if isinstance(item, MissionProgram)
        else item.actions.values()
        if isinstance(item, TaskRun)
        else ()
    )
    found = [run for run in runs if run.state is ActionState.PAUSED and run.paused_by == item.paused_by]
    return [item] if isinstance(item, ActionRun) else found


def check_resumable(board: Board, item: MissionItem) -> None:
    """Checks that everything that would resume can continue now.

    Raises:
        Refused: with the reason.
    """
    for run in _paused_in(item):
        holder = board.assignments.holder(run.row)
        if holder is not None:
            raise Refused(f"{run.target} needs {run.row.claims[0]}, claimed by {holder.label}; pause or abort it first")
        order = run.action.order  # a landing that was paused as it ended is done when it goes on
        if run.is_motion and not board.is_airborne and not (order.begins_flight or isinstance(order, LandOrder)):
            raise Refused(f"the vehicle is on the ground, and {run.target} was paused in the air; abort it")
        if run.action.ability in board.missing:
            missing = board.missing.words(run.action.ability)
            raise Refused(f"{run.action.ability} is not available: it lacks {missing}")


def go_on(board: Board, item: MissionItem, now_s: float) -> None:
    """Resumes an item and everything paused with it, and retries failed items in it."""
    by = item.paused_by
    runs = _paused_in(item)
    if isinstance(item, MissionProgram):
        board.move(item, StateTrigger.RESUME, now_s)
        for task in item.own_tasks:
            if task.state is ActionState.PAUSED and task.paused_by == by:
                board.move(task, StateTrigger.RESUME, now_s)
            elif task.state is ActionState.FAILED and not task.is_settled:
                retry(board, task, now_s)
    elif isinstance(item, TaskRun):
        board.move(item, StateTrigger.RESUME, now_s)
    for run in runs:
        go_on_after_pause(board, run, now_s)
    if isinstance(item, MissionProgram | TaskRun):
        waiting = item.actions() if isinstance(item, MissionProgram) else iter(item.actions.values())
        for run in waiting:
            if run.state is ActionState.FAILED and not run.is_settled:
                retry(board, run, now_s)
