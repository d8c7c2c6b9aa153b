"""Operators' commands that need more than a move: what must hold before a start or a resume, and what follows an abort."""

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3.mission.checking.checker import home_problem
from gloc3.mission.executing import elsewhere, manoeuvres, reactions
from gloc3.mission.executing.assignments import MOTION
from gloc3.mission.executing.board import Board, PolicyCondition
from gloc3.mission.executing.failures import reopen, retry
from gloc3.mission.executing.flow import go_on_after_pause
from gloc3.mission.executing.items import ActionRun, MissionItem, MissionProgram, TaskRun
from gloc3.mission.model.arguments import SetOff, TakeOff
from gloc3.mission.model.model import Mission
from gloc3.mission.model.policy import MANOEUVRES, Policy, resolved
from gloc3.mission.model.states import ActionState, StateTrigger
from gloc3.mission.model.structure import PartialOrder

BY_OPERATOR = "by an operator"


def start(board: Board, item: MissionItem, now_s: float, home_ned_m: Vector3 | None) -> None:
    """Starts the mission, where the vehicle stands inside its fence.

    Raises:
        Refused: it cannot be started now; nothing has changed.
    """
    if not isinstance(item, MissionProgram):
        raise Refused(f"{item.target} starts when its predecessors have ended; start the mission")
    refuse_while_unfit(board)
    for condition, reason in board.conditions.items():
        if condition is not PolicyCondition.LINK_LOST:
            raise Refused(f"{condition}" + (f": {reason}" if reason else ""))
    check_readiness(board, item.mission)
    if home_ned_m is not None and (problem := home_problem(item.mission, home_ned_m)):
        raise Refused(problem)
    manoeuvres.dismiss(board, now_s)
    board.policies = item.mission.policies
    elsewhere.expect(board, item, now_s)
    board.move(item, StateTrigger.START, now_s, BY_OPERATOR)


def refuse_while_unfit(board: Board) -> None:
    """Refuses motion while a pilot or a policy moves the vehicle.

    Raises:
        Refused: with the reason.
    """
    if board.has_pilot:
        raise Refused(f"{board.controller} has control; resume the mission to take it back")
    manoeuvre = board.manoeuvre
    if manoeuvre is not None and manoeuvre.contingency is not None:
        raise Refused(_busy(manoeuvre.contingency.task, manoeuvre.cause))
    if manoeuvre is not None and manoeuvre.policy is not Policy.HOLD:
        raise Refused(f"the policy {manoeuvre.policy} is being carried out ({manoeuvre.cause})")


def _busy(task: str, cause: str) -> str:
    return f"the contingency {task} is under way ({cause}); skip or abort it first"


def check_readiness(board: Board, mission: Mission) -> None:
    """A mission starts only if everything that it uses is there, and the vehicle is where its first action needs it.

    Raises:
        Refused: with the reason.
    """
    actions = mission.actions()
    for action in actions.values():
        if action.ability in board.missing:
            missing = board.missing.words(action.ability)
            raise Refused(f"{action.ability} is not available: it lacks {missing}")
        row = board.rows[action.ability]
        holder = board.assignments.holder(row)
        if holder is not None:
            shared = next(name for name in row.claims if board.assignments.claims.get(name) is holder)
            raise Refused(f"{shared} is claimed by {holder.label}; pause or abort it first")
    targets = PartialOrder.of(mission).targets
    first = next((actions[one].order for one in targets if MOTION in board.rows[actions[one].ability].claims), None)
    if isinstance(first, SetOff) and board.is_airborne:
        at = "in the air" if isinstance(first, TakeOff) else "under way"
        raise Refused(f"the vehicle is already {at}, but the mission begins with a departure")
    if first is not None and not isinstance(first, SetOff) and not board.is_airborne:
        raise Refused("the vehicle is on the ground, but the mission does not begin with take_off, drive_off or dive")


def take_back(board: Board, now_s: float) -> None:
    """Returns control to the mission when an operator resumes after a pilot."""
    mission = board.mission
    if mission is not None and mission.state is ActionState.PAUSED:
        check_resumable(board, mission)
    board.has_pilot = board.is_failsafe = False
    board.is_taking_back = True
    unanswered = dict(board.unanswered)
    board.unanswered.clear()
    if mission is not None and mission.state is ActionState.PAUSED:
        go_on(board, mission, now_s)
    for condition, reason in unanswered.items():
        if condition in board.conditions:
            reactions.apply_policy(board, condition, reason, now_s)


def resume(board: Board, item: MissionItem, now_s: float) -> None:
    """Resumes a paused item.

    Raises:
        Refused: it cannot go on now; nothing has changed.
    """
    if board.has_pilot:
        raise Refused(f"{board.controller} has control; resume the mission to take it back")
    for parent in _parents(item):
        if parent.state is ActionState.PAUSED:
            raise Refused(f"the {parent.level} is paused; resume it first")
    manoeuvre = board.manoeuvre
    if manoeuvre is not None and manoeuvre.contingency is not None:
        if item not in (manoeuvre.program, *(manoeuvre.program.items() if manoeuvre.program is not None else ())):
            raise Refused(_busy(manoeuvre.contingency.task, manoeuvre.cause))
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
        if run.is_motion and not board.is_airborne and not isinstance(run.action.order, SetOff):
            raise Refused(f"the vehicle is on the ground, and {run.target} was paused in the air; abort it")
        if run.action.ability in board.missing:
            missing = board.missing.words(run.action.ability)
            raise Refused(f"{run.action.ability} is not available: it lacks {missing}")


def go_on(board: Board, item: MissionItem, now_s: float) -> None:
    """Resumes an item, what was paused with it, and tries again what has failed in it."""
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
