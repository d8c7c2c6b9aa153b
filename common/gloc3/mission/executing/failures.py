"""Handling of failures: another attempt, or the policy of the action, task or mission."""

from gloc3.messages.envelope import Severity
from gloc3.mission.executing import manoeuvres
from gloc3.mission.executing.board import Board
from gloc3.mission.executing.items import ActionRun, MissionProgram, TaskRun
from gloc3.mission.model.model import attempts
from gloc3.mission.model.policy import Policy, resolved
from gloc3.mission.model.states import ActionState, StateTrigger


def fail_action(board: Board, run: ActionRun, reason: str, now_s: float, *, is_over: bool = False) -> None:
    """Handles the failure of an action.

    Args:
        board: the executor's state.
        run: the action.
        reason: the reason.
        now_s: the time.
        is_over: whether its component has ended it already.
    """
    with board.because(f"failed {run.target}"):
        _fail_action(board, run, reason, now_s, is_over=is_over)


def _fail_action(board: Board, run: ActionRun, reason: str, now_s: float, *, is_over: bool) -> None:
    board.release(run, is_over=is_over)
    if run.action.order.begins_flight and is_over:
        board.air.is_taking_off = False
    board.move(run, StateTrigger.FAIL, now_s, reason)
    if run.has_attempts_left:
        board.move(run, StateTrigger.RETRY, now_s, f"attempt {run.starts + 1} of {attempts(run.options)}")
    elif run.policy is None:
        fail_task(board, run.task, f"{run.action.name} failed: {reason}", now_s)
    elif run.policy is Policy.CONTINUE:
        run.is_settled = True
    elif run.policy is Policy.SKIP:
        board.move(run, StateTrigger.SKIP, now_s, reason)
    else:
        _manoeuvre(board, run.task.program, run.policy, f"{run.target} failed: {reason}", now_s)


def fail_task(board: Board, task: TaskRun, reason: str, now_s: float, *, is_late: bool = False) -> None:
    """A task has failed because of one of its actions, or (`is_late`) because of its deadline."""
    with board.because(f"failed {task.target}"):
        _fail_task(board, task, reason, now_s, is_late=is_late)


def _fail_task(board: Board, task: TaskRun, reason: str, now_s: float, *, is_late: bool) -> None:
    if is_late:
        for run in task.actions.values():
            if run.is_open:
                board.release(run)
                board.move(run, StateTrigger.FAIL, now_s, reason)
    program = task.program
    default = program.mission.policies.on_failure
    policy = task.policy if task.policy is not None else default
    has_attempts_left = task.has_attempts_left or (policy is Policy.RETRY and task.starts < 2)
    if policy is Policy.CONTINUE and not is_late and not has_attempts_left:
        for run in task.actions.values():
            run.is_settled = run.is_settled or run.state is ActionState.FAILED
        task.blemish = reason
        board.report(Severity.WARNING, f"{task.target} goes on: {reason}")
        return
    if policy is Policy.SKIP and not has_attempts_left:
        board.end(task, StateTrigger.SKIP, now_s, reason)
        return
    if task.state is ActionState.WAITING:  # another attempt is to begin already: this action is tried again in it
        for run in task.actions.values():
            if run.state is ActionState.FAILED and not run.is_settled:
                board.move(run, StateTrigger.RETRY, now_s)
                run.starts = 0
        return
    if task.state is not ActionState.FAILED:
        board.move(task, StateTrigger.FAIL, now_s, reason)
    if has_attempts_left:
        retry(board, task, now_s)
    elif policy is Policy.CONTINUE:
        for run in task.actions.values():
            if run.state is ActionState.FAILED:
                run.is_settled = True
            elif not run.has_ended:
                board.end(run, StateTrigger.SKIP, now_s, reason)
        task.is_settled = True
    else:
        manoeuvre = Policy.HOLD if policy is Policy.RETRY else policy
        _manoeuvre(board, program, manoeuvre, f"{task.target} failed: {reason}", now_s)


def fail_program(board: Board, program: MissionProgram, reason: str, now_s: float) -> None:
    """A mission, or a single task or action, has failed as a whole."""
    with board.because(f"failed {program.name}"):
        board.end_all(program, StateTrigger.ABORT, now_s, reason)
        board.move(program, StateTrigger.FAIL, now_s, reason)
        on_failure = program.mission.policies.on_failure
        manoeuvres.apply(board, resolved(Policy.ABORT, on_failure), reason, now_s)


def retry(board: Board, item: TaskRun | ActionRun, now_s: float) -> None:
    """Has what failed wait for another attempt."""
    if isinstance(item, TaskRun):
        for run in item.actions.values():
            if run.state is ActionState.FAILED and not run.is_settled:
                board.move(run, StateTrigger.RETRY, now_s)
                run.starts = 0
        board.move(item, StateTrigger.RETRY, now_s, f"attempt {item.starts + 1}")
    else:
        board.move(item, StateTrigger.RETRY, now_s)
        item.starts = 0
        reopen(board, item.task, now_s)


def reopen(board: Board, task: TaskRun, now_s: float) -> None:
    """Continues a failed task once no failed item is left in it."""
    is_clear = all(run.state is not ActionState.FAILED or run.is_settled for run in task.actions.values())
    if task.state is ActionState.FAILED and not task.is_settled and is_clear:
        board.move(task, StateTrigger.RETRY, now_s)


def _manoeuvre(board: Board, program: MissionProgram, policy: Policy, cause: str, now_s: float) -> None:
    manoeuvres.apply(board, resolved(policy, program.mission.policies.on_failure), cause, now_s)
