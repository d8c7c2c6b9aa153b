"""Starts and advances programs: ends and starts items, and watches guards, loops, deadlines and availability."""

from collections.abc import Iterable
from enum import Enum, auto
from math import inf
from typing import Final

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3.messages.standard_topics import POSE_LOST_S
from gloc3.messages.summaries import component_cause
from gloc3.mission.checking.checker import home_problem
from gloc3.mission.executing import elsewhere, manoeuvres, reactions
from gloc3.mission.executing.assignments import MOTION, Assignment, AssignmentPhase
from gloc3.mission.executing.board import BY_OPERATOR, Board, PolicyCondition, PolicyManoeuvre
from gloc3.mission.executing.failures import fail_action, fail_program, fail_task
from gloc3.mission.executing.items import MISSION, ActionRun, MissionItem, MissionProgram, TaskRun
from gloc3.mission.model.arguments import TakeOff, Wait
from gloc3.mission.model.model import Mission
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState, StateTrigger
from gloc3.mission.model.structure import PartialOrder

GO_TO: Final = "go_to"
GRACE_S: Final = 1.5
"""How long a running action survives the loss of a requirement, s: a standby takes over, or it is started a second time."""
POSE_NEEDS: Final = frozenset({"pose", "autopilot_pose"})
"""What may be late for `POSE_LOST_S`; then `on_pose_lost` acts."""
WAIT_STEP: Final = 0.05
WAIT_STEP_S: Final = 1.0
"""Shortest interval between writes of a wait's progress to disk, s."""
TIMEOUT_S: Final = 2.0
"""How long an action that is to start waits for its requirements, s."""
GUARD_TIMEOUT_S: Final = 2.0
"""How long a guard waits for a quantity that is not measured at the moment, s; then it counts as not met."""


def start_mission(board: Board, item: MissionItem, now_s: float, home_ned_m: Vector3 | None) -> None:
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
    refuse_outside(item, home_ned_m)
    manoeuvres.dismiss(board, now_s)
    board.policies = item.mission.policies
    elsewhere.expect(board, item, now_s)
    board.move(item, StateTrigger.START, now_s, BY_OPERATOR)


def refuse_outside(program: MissionProgram | None, home_ned_m: Vector3 | None) -> None:
    """Refuses to take off for a mission where home, if it is known, is outside its fence.

    Raises:
        Refused: with the reason.
    """
    if program is not None and home_ned_m is not None and (problem := home_problem(program.mission, home_ned_m)):
        raise Refused(problem)


def refuse_while_unfit(board: Board) -> None:
    """Refuses motion while a pilot or a policy moves the vehicle.

    Raises:
        Refused: with the reason.
    """
    if board.has_pilot:
        raise Refused(f"{board.controller} has control; resume the mission to take it back")
    manoeuvre = board.manoeuvre
    if manoeuvre is not None and manoeuvre.contingency is not None:
        raise Refused(busy(manoeuvre))
    if manoeuvre is not None and manoeuvre.policy is not Policy.HOLD:
        raise Refused(f"the policy {manoeuvre.policy} is being carried out ({manoeuvre.cause})")


def busy(manoeuvre: PolicyManoeuvre) -> str:
    """Why nothing else begins while a contingency runs."""
    task = manoeuvre.contingency.task if manoeuvre.contingency is not None else ""
    return f"the contingency {task} is under way ({manoeuvre.cause}); skip or abort it first"


def make_room(board: Board, mission: Mission, programs: Iterable[MissionProgram]) -> None:
    """Makes room for new tasks: single commands that have ended go.

    Raises:
        Refused: one of the programs has a task of that name; nothing has changed.
    """
    claimed = {task for program in programs if program.is_open or program.is_mission for task in program.tasks}
    for task in mission.tasks:
        if task in claimed:
            raise Refused(f"task {task!r} already exists")
    for name in [name for name, previous in board.programs.items() if name != MISSION and not previous.is_open]:
        del board.programs[name]


def redirected(board: Board, mission: Mission) -> MissionProgram | None:
    """The single `go_to` under way, of which a command takes the place that is another one."""
    if [one.ability for one in mission.actions().values()] != [GO_TO]:
        return None
    commands = (one for name, one in board.programs.items() if name != MISSION and one.is_open)
    return next((one for one in commands if [run.action.ability for run in one.actions()] == [GO_TO]), None)


def check_readiness(board: Board, mission: Mission, replaced: MissionProgram | None = None) -> None:
    """A mission starts only if everything that it uses is there, and the vehicle is where its first action needs it.

    Args:
        board: the state.
        mission: the mission, or a single command.
        replaced: what it takes the place of, and whose resources it may take.

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
        if holder is not None and not (replaced is not None and any(one is holder.run for one in replaced.actions())):
            shared = next(name for name in row.claims if board.assignments.claims.get(name) is holder)
            raise Refused(f"{shared} is claimed by {holder.label}; pause or abort it first")
    targets = PartialOrder.of(mission).targets
    first = next((actions[one].order for one in targets if MOTION in board.rows[actions[one].ability].claims), None)
    if first is not None and first.begins_flight and board.is_airborne:
        at = "in the air" if isinstance(first, TakeOff) else "under way"
        raise Refused(f"the vehicle is already {at}, but the mission starts with a departure")
    if first is not None and not first.begins_flight and not board.is_airborne:
        found = f", but with {first.begins_with}" if first.begins_with else ""
        raise Refused(
            f"the vehicle is on the ground, and the mission does not begin with take_off, drive_off or dive{found}"
        )


def advance(board: Board, now_s: float) -> None:
    """Does everything that can be done now."""
    for assignment in list(board.assignments.by_id.values()):
        due_s = assignment.due_s()
        if due_s is not None and now_s >= due_s:
            with board.because(component_cause(assignment.component)):
                lose(board, assignment, _silence(assignment), now_s)
    for program in list(board.programs.values()):
        if program.is_open:
            _watch(board, program, now_s)
    elsewhere.watch(board, now_s)
    _watch_obstacle(board, now_s)
    is_moving = True
    while is_moving:
        is_moving = False
        for program in list(board.programs.values()):
            is_moving |= _go_on(board, program, now_s)
    manoeuvres.advance(board, now_s)


def _silence(assignment: Assignment) -> str:
    if assignment.requested_s is not None:
        return f"{assignment.component} does not answer"
    return f"{assignment.component} has stopped reporting"


def lose(board: Board, assignment: Assignment, reason: str, now_s: float, *, is_over: bool = False) -> None:
    """Handles a component that cannot perform its action, or has left.

    Args:
        board: the executor's state.
        assignment: its assignment.
        reason: the reason.
        now_s: the time.
        is_over: whether it has ended the action already.
    """
    verb, run = assignment.verb, assignment.run
    was_requested = assignment.requested_s is not None
    board.assignments.drop(assignment, is_over=is_over)
    if run is None:
        manoeuvres.ended(board, assignment, ActionState.FAILED, reason, now_s)
    elif verb == "resume" and was_requested and run.state is ActionState.RUNNING:
        _assign(board, run, now_s)  # it has forgotten the action: once more from where it was
    elif verb != "pause" and run.is_open:
        fail_action(board, run, reason, now_s, is_over=is_over)


def _watch(board: Board, program: MissionProgram, now_s: float) -> None:
    """Deadlines, and what running actions need."""
    if now_s >= program.due_s():
        fail_program(board, program, f"deadline of {program.deadline_s:g} s passed", now_s)
        return
    for task in program.own_tasks:
        if now_s >= task.due_s():
            fail_task(board, task, f"deadline of {task.deadline_s:g} s passed", now_s, is_late=True)
        for run in task.actions.values():
            if run.state is not ActionState.RUNNING:
                continue
            if now_s >= run.due_s():
                fail_action(board, run, f"deadline of {run.deadline_s:g} s passed", now_s)
            elif now_s >= lost_at_s(board, run):
                missing = board.missing.words(run.action.ability)
                fail_action(board, run, f"{run.action.ability} is no longer available ({missing})", now_s)
            elif isinstance(run.action.order, Wait):
                _wait(board, run, run.action.order.duration_s, now_s)


def _watch_obstacle(board: Board, now_s: float) -> None:
    """Handles an obstacle that has been in the way for too long, or is gone."""
    if MOTION not in board.assignments.claims:
        board.blocked_since_s = None
    is_on = now_s >= obstacle_due_s(board)
    if is_on != (PolicyCondition.OBSTACLE in board.conditions):
        reason = f"it blocks the path for {board.policies.obstacle_after_s:g} s" if is_on else ""
        reactions.set_condition(board, PolicyCondition.OBSTACLE, is_on, reason, now_s)


def obstacle_due_s(board: Board) -> float:
    """When the obstacle in the way exceeds its time limit; infinite without one."""
    return inf if board.blocked_since_s is None else board.blocked_since_s + board.policies.obstacle_after_s


def _wait(board: Board, run: ActionRun, duration_s: float, now_s: float) -> None:
    """A wait is over, or has come so far that it is worth keeping."""
    if now_s >= run.reaches_s(duration_s):
        run.progress = 1.0
        board.move(run, StateTrigger.FINISH, now_s)
    elif now_s >= _wait_due_s(run, duration_s):
        run.progress = run.ran_s(now_s) / duration_s
        board.is_changed = True


def _wait_due_s(run: ActionRun, duration_s: float) -> float:
    """When something is to be done about a wait."""
    next_s = run.progress * duration_s + max(WAIT_STEP * duration_s, WAIT_STEP_S)
    return run.reaches_s(min(next_s, duration_s))


def lost_at_s(board: Board, run: ActionRun) -> float:
    """When a running action fails for lack of a requirement; infinite where the policy for a lost pose applies."""
    name = run.action.ability
    missing = board.missing.get(name)
    is_pose = missing is not None and POSE_NEEDS.issuperset(missing)
    if missing is None or (is_pose and PolicyCondition.POSE_LOST in board.conditions):
        return inf
    return board.missing.since_s[name] + GRACE_S + (POSE_LOST_S if is_pose else 0.0)


def _go_on(board: Board, program: MissionProgram, now_s: float) -> bool:
    """Runs one pass over a program; returns whether anything has changed."""
    if not program.is_open:
        return False
    has_moved = False
    for task in program.own_tasks:
        for run in task.actions.values():
            has_moved |= _end_companion(board, run, now_s)
        is_next = program.state is ActionState.RUNNING and task.state is ActionState.WAITING
        if is_next and all(program.tasks[name].has_ended for name in task.options.after):
            leave = guard_decision(board, task, now_s)
            if leave is GuardDecision.BEGIN:
                board.move(task, StateTrigger.START, now_s)
            has_moved |= leave is not GuardDecision.WAIT
        if program.state is ActionState.RUNNING and task.state is ActionState.RUNNING:
            for run in task.actions.values():
                if task.state is ActionState.RUNNING:  # the guard of one before may have failed it
                    has_moved |= _start_action(board, run, now_s)
        if task.is_open and all(run.has_ended for run in task.actions.values()):
            has_moved |= _end_task(board, task, now_s)
        if not program.is_open:
            return True
    if all(task.has_ended for task in program.own_tasks):
        failed = [task for task in program.own_tasks if task.state is ActionState.FAILED]
        if failed and not program.is_mission:
            board.move(program, StateTrigger.FAIL, now_s, failed[0].reason)
        else:
            board.move(program, StateTrigger.FINISH, now_s)
        return True
    return has_moved


def _end_task(board: Board, task: TaskRun, now_s: float) -> bool:
    """Repeats a task whose actions have all ended, or ends it; whether anything has changed."""
    is_repeated = is_to_repeat(board, task, now_s)
    if is_repeated is None:
        return False
    if is_repeated:
        return begin_repetition(board, task, now_s)
    board.move(task, StateTrigger.FAIL if task.blemish else StateTrigger.FINISH, now_s, task.blemish)
    task.is_settled = True
    return True


def _end_companion(board: Board, run: ActionRun, now_s: float) -> bool:
    """Ends an action whose `until` has ended."""
    companion = run.task.actions.get(run.until) if run.until is not None else None
    if companion is None or not companion.has_ended or run.has_ended or run.state is ActionState.FAILED:
        return False
    if run.state is ActionState.WAITING:
        board.move(run, StateTrigger.SKIP, now_s, f"{run.until} had ended before it began")
    else:
        board.release(run)
        board.move(run, StateTrigger.FINISH, now_s, f"{run.until} ended")
    return True


def _start_action(board: Board, run: ActionRun, now_s: float) -> bool:
    """Starts an action that may start now; whether anything has changed."""
    siblings = run.task.actions
    since_s, run.unavailable_since_s = run.unavailable_since_s, None
    if run.state is not ActionState.WAITING or not all(siblings[name].has_ended for name in run.options.after):
        return False
    if board.has_pilot or (run.is_motion and not _may_move(board, run)):
        return False
    leave = guard_decision(board, run, now_s)
    if leave is not GuardDecision.BEGIN:
        return leave is GuardDecision.ENDED
    holder = board.assignments.holder(run.row)
    if holder is not None:
        run.reason = f"waits for {holder.label}"
        return False
    if run.action.ability in board.missing:
        since_s = now_s if since_s is None else since_s
        missing = run.reason = f"waits for {board.missing.words(run.action.ability)}"
        if now_s < since_s + TIMEOUT_S:
            run.unavailable_since_s = since_s
            return False
        board.move(run, StateTrigger.START, now_s)
        fail_action(board, run, f"{run.action.ability} is not available: it {missing}", now_s)
        return True
    board.move(run, StateTrigger.START, now_s)
    _assign(board, run, now_s)
    return True


def _may_move(board: Board, run: ActionRun) -> bool:
    """Whether no policy moves the vehicle instead; a contingency's own actions do so for one."""
    return board.manoeuvre is None or board.manoeuvre.program is run.task.program


def _assign(board: Board, run: ActionRun, now_s: float) -> None:
    """Hands a running action to its component, unless it needs none."""
    if not run.row.performed_by:
        return
    if run.action.order.begins_flight:
        board.air.depart()
    board.is_changed = True
    board.assignments.start(run.target, run.action.ability, run.row, run.action.order, run, now_s)


def go_on_after_pause(board: Board, run: ActionRun, now_s: float) -> None:
    """Resumes a paused action at its component, or restarts it where the component no longer has it."""
    board.move(run, StateTrigger.RESUME, now_s)
    assignment = board.assignment(run)
    if assignment is not None and assignment.phase is AssignmentPhase.PAUSED:
        if run.action.order.begins_flight:
            board.air.depart()
        board.assignments.resume(assignment, now_s)
    else:
        _assign(board, run, now_s)


def finish_action(board: Board, run: ActionRun, now_s: float) -> None:
    """An action's component says that it is done."""
    board.release(run, is_over=True)
    run.progress = 1.0
    if run.action.order.ends_flight:
        board.air.land()
    board.move(run, StateTrigger.FINISH, now_s)


def due_s(board: Board) -> float:
    """When something happens next by the passing of time alone; infinite if nothing does."""
    times = [at_s for one in board.assignments.by_id.values() if (at_s := one.due_s()) is not None]
    for program in board.programs.values():
        if not program.is_open:
            continue
        times += [program.due_s(), *(item.due_s() for item in program.items())]
        times += [guard_due_s(item) for item in program.items()]
        for run in program.actions():
            if run.state is ActionState.RUNNING:
                times.append(lost_at_s(board, run))
                if isinstance(run.action.order, Wait):
                    times.append(_wait_due_s(run, run.action.order.duration_s))
            elif run.state is ActionState.WAITING and run.unavailable_since_s is not None:
                times.append(run.unavailable_since_s + TIMEOUT_S)
    times += [manoeuvres.lost_at_s(board), elsewhere.due_s(board)]
    if PolicyCondition.OBSTACLE not in board.conditions:
        times.append(obstacle_due_s(board))
    manoeuvre = board.manoeuvre
    if manoeuvre is not None:
        times += [at_s for at_s in (manoeuvre.land_at_s, manoeuvre.again_s) if at_s is not None]
    return min(times, default=inf)


class GuardDecision(Enum):
    """Decisions of a guard."""

    BEGIN = auto()
    WAIT = auto()
    ENDED = auto()
    """The item was skipped, or has failed."""


def guard_decision(board: Board, item: TaskRun | ActionRun, now_s: float) -> GuardDecision:
    """Whether an item whose turn has come may start; if not, its guard decides: skip, wait or fail."""
    guard = item.options.when
    if guard is None:
        return GuardDecision.BEGIN
    holds = guard.holds(board.readings)
    if holds:
        item.rest(now_s)
        return GuardDecision.BEGIN
    is_waited_for = item.options.otherwise == "wait" or holds is None
    if is_waited_for and now_s < item.gives_up_s(GUARD_TIMEOUT_S):
        item.await_permission(now_s, f"waits for {guard}")
        return GuardDecision.WAIT
    item.rest(now_s)
    missing = f"{guard} is not known" if holds is None else f"not {guard}"
    if item.options.otherwise == "skip":
        board.end(item, StateTrigger.SKIP, now_s, missing)
        return GuardDecision.ENDED
    board.move(item, StateTrigger.START, now_s)
    reason = missing if item.options.otherwise == "fail" else f"deadline passed while waiting for {guard}"
    if isinstance(item, TaskRun):
        fail_task(board, item, reason, now_s)
    else:
        fail_action(board, item, reason, now_s)
    return GuardDecision.ENDED


def guard_due_s(item: TaskRun | ActionRun) -> float:
    """When an item that waits for its guard, or to know of its repetition, gives up; infinite where it does not wait."""
    if isinstance(item, TaskRun) and item.unknown_since_s is not None:
        return item.unknown_since_s + GUARD_TIMEOUT_S
    return item.gives_up_s(GUARD_TIMEOUT_S)


def is_guard_waited_for(board: Board) -> bool:
    """Whether any item waits for its guard, or to know of its repetition."""
    return any(
        guard_due_s(item) < inf for program in board.programs.values() if program.is_open for item in program.items()
    )


def is_to_repeat(board: Board, task: TaskRun, now_s: float) -> bool | None:
    """Whether an open task whose actions have all ended is to be repeated; None while it waits to know."""
    repeat = task.repeat
    if repeat is None or task.repetition >= repeat.times:
        return False
    if all(run.state is ActionState.ABORTED for run in task.actions.values()):
        return False  # nothing is left to repeat
    holds = repeat.until is not None and repeat.until.holds(board.readings)
    if holds is not None or task.state is not ActionState.RUNNING:
        return not holds
    if task.unknown_since_s is None:
        task.unknown_since_s = now_s
    return None if now_s < task.unknown_since_s + GUARD_TIMEOUT_S else True


def begin_repetition(board: Board, task: TaskRun, now_s: float) -> bool:
    """Resets all actions of a task to waiting; returns whether it did: a paused task is not repeated."""
    assert task.repeat is not None
    if task.state is not ActionState.RUNNING:
        return False
    task.repetition += 1
    task.unknown_since_s = None
    for run in task.actions.values():
        if run.state is not ActionState.ABORTED:
            run.move(StateTrigger.RETRY if run.state is ActionState.FAILED else StateTrigger.REPEAT, now_s)
            run.reset()
    board.is_changed = True
    board.report(Severity.INFO, f"{task.target}: {task.repetition} of {task.repeat.times}")
    return any(run.state is ActionState.WAITING for run in task.actions.values())
