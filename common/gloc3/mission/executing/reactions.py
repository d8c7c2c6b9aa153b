"""Reactions to conditions of the vehicle and its link: policies, contingencies, planned silences.

A contingency is a task that a mission has ready for a condition. It runs in the place of a policy's manoeuvre: the mission
is paused meanwhile, and no less severe policy interrupts it. From the start of a task or action that plans a silence, a
lost link is no fault until the stated time has passed.
"""

from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import component_cause
from gloc3.mission.executing import manoeuvres
from gloc3.mission.executing.board import Board, PolicyCondition, PolicyManoeuvre
from gloc3.mission.executing.items import MissionProgram
from gloc3.mission.executing.snapshot import PlannedSilence
from gloc3.mission.model.arguments import LandOrder, SetOff
from gloc3.mission.model.model import Contingency, answer, part_of
from gloc3.mission.model.policy import MANOEUVRES, SEVERITY, Policy, resolved
from gloc3.mission.model.states import RESTART, ActionState, StateTrigger

CONTINGENCY: Final = "contingency"
"""Name of the program of an active contingency."""
KEEP_SILENCE_S: Final = 30.0
"""Interval at which the progress of a planned silence is written to disk, s, for restarts of the computer."""


def set_condition(board: Board, condition: PolicyCondition, is_on: bool, reason: str, now_s: float) -> None:
    """Sets or clears a condition; its policy is executed once, when it arises."""
    if is_on == (condition in board.conditions):
        return
    if is_on:
        board.conditions[condition] = reason
        with board.because(condition.cause):
            apply_policy(board, condition, reason, now_s)
    else:
        del board.conditions[condition]
        board.unanswered.pop(condition, None)
        board.report(Severity.INFO, f"{condition}: over")


def apply_policy(board: Board, condition: PolicyCondition, reason: str, now_s: float) -> None:
    """Answers a condition that has just arisen with the governing policies."""
    if board.has_pilot:
        board.unanswered[condition] = reason
        board.report(Severity.WARNING, f"{condition}: {reason}; {board.controller} has control")
        return
    wanted = _wanted(board, condition)
    if isinstance(wanted, Contingency) and begin_contingency(board, wanted, str(condition), now_s):
        return
    policy = resolved(answer(wanted), board.policies.on_failure)
    board.report(Severity.WARNING, f"{condition}{': ' + reason if reason else ''}; policy: {policy}")
    if policy in MANOEUVRES:
        manoeuvres.apply(board, policy, str(condition), now_s)


def answer_waiting(board: Board, now_s: float) -> None:
    """Answers what has arisen while a pilot had control, and still is so, as control is ours again."""
    unanswered, lost = dict(board.unanswered), dict(board.lost)
    board.unanswered.clear()
    board.lost.clear()
    for condition, reason in unanswered.items():
        if condition in board.conditions:
            with board.because(condition.cause):
                apply_policy(board, condition, reason, now_s)
    for component, (policy, reason) in lost.items():
        with board.because(component_cause(component)):
            lose_component(board, component, policy, reason, now_s)


def lifted_off(board: Board, now_s: float) -> None:
    """The vehicle is in the air without a take-off that began in this life of the process.

    What was commanded before a restart on the ground may have taken it off: `on_restart` applies then, as in flight; the
    mission has been paused in between and is not continued.
    """
    if board.has_pilot or all(program.reason != RESTART for program in board.programs.values()):
        return
    for program in board.programs.values():
        finish_interrupted(board, program, SetOff, now_s)
    left_in_restart(board, "restart during the take-off", now_s)


def finish_interrupted(board: Board, program: MissionProgram, kind: type[SetOff | LandOrder], now_s: float) -> None:
    """Ends the take-offs or landings that a restart has interrupted, where the vehicle shows that they are over."""
    for run in program.actions():
        if run.is_open and isinstance(run.action.order, kind):
            board.move(run, StateTrigger.FINISH, now_s, RESTART)


def left_in_restart(board: Board, cause: str, now_s: float) -> None:
    """Carries out `on_restart` in flight; a mission that cannot be continued holds."""
    policy = Policy(board.policies.on_restart)
    manoeuvres.apply(board, Policy.HOLD if policy is Policy.CONTINUE else policy, cause, now_s)


def lose_component(board: Board, component: str, policy: Policy, reason: str, now_s: float) -> None:
    """Reacts to the permanent loss of a component's function by its row's policy, or the mission's if it has one."""
    cause, wanted = f"{component} is lost ({reason})", board.policies.on_component_fault
    if isinstance(wanted, Contingency) and resolved(policy, board.policies.on_failure) is not Policy.LAND:
        board.report(Severity.ERROR, f"{cause}; contingency: {wanted.task}")
        if begin_contingency(board, wanted, cause, now_s):
            return
    on_failure = board.policies.on_failure
    both = resolved(policy, on_failure), resolved(answer(wanted), on_failure)
    worst = max(both, key=lambda one: SEVERITY[one])
    board.report(Severity.ERROR, f"{cause}; policy: {worst}")
    manoeuvres.apply(board, worst, cause, now_s)


def _wanted(board: Board, condition: PolicyCondition) -> str | Contingency:
    policies = board.policies
    match condition:
        case PolicyCondition.LINK_LOST:
            return policies.on_link_loss
        case PolicyCondition.OVERDUE:
            return policies.on_overdue or policies.on_link_loss
        case PolicyCondition.LOW_BATTERY:
            return policies.on_low_battery
        case PolicyCondition.POSE_LOST:
            return policies.on_pose_lost
        case PolicyCondition.OBSTACLE:
            return policies.on_obstacle
        case PolicyCondition.PLATFORM_LOST:
            return policies.on_platform_loss
        case PolicyCondition.FENCE_BREACHED:
            return Policy.ABORT


def begin_contingency(board: Board, wanted: Contingency, cause: str, now_s: float) -> bool:
    """Starts a contingency.

    Returns:
        Whether it was handled: it runs, or a more severe policy is active. If not, the caller has to apply its `then`.
    """
    mission = board.mission
    task = mission.mission.contingencies.get(wanted.task) if mission is not None else None
    if mission is None or task is None or not task.actions or not board.is_airborne:
        return False
    policy, current = answer(wanted), board.manoeuvre
    if current is not None and SEVERITY[current.policy] >= SEVERITY[policy]:
        return True
    manoeuvres.stop(board, now_s)
    reason = f"{cause}: {wanted.task}"
    for program in list(board.programs.values()):
        if program.is_mission:
            board.halt(program, "mission", now_s, reason)
        else:
            manoeuvres.end_program(board, program, StateTrigger.ABORT, now_s, reason)
    program = board.program(CONTINGENCY, part_of(mission.mission, wanted.task))
    board.manoeuvre = contingency_manoeuvre(program, wanted, cause)
    board.report(Severity.WARNING, f"contingency {wanted.task}: {cause}")
    board.move(program, StateTrigger.START, now_s)
    return True


def contingency_manoeuvre(program: MissionProgram, wanted: Contingency, cause: str) -> PolicyManoeuvre:
    """The policy manoeuvre for a contingency."""
    manoeuvre = PolicyManoeuvre(answer(wanted), cause)
    manoeuvre.contingency, manoeuvre.program = wanted, program
    return manoeuvre


def has_contingency_ended(board: Board) -> bool:
    """Whether the active contingency has ended."""
    manoeuvre = board.manoeuvre
    return manoeuvre is not None and manoeuvre.program is not None and not manoeuvre.program.is_open


def end_contingency(board: Board, now_s: float) -> bool:
    """Applies the follow-up of a contingency that has ended; returns whether the mission is to be resumed."""
    manoeuvre = board.manoeuvre
    assert manoeuvre is not None
    assert manoeuvre.contingency is not None
    assert manoeuvre.program is not None
    wanted, is_done = manoeuvre.contingency, manoeuvre.program.state is ActionState.DONE
    board.manoeuvre, board.is_changed = None, True
    cause = f"{manoeuvre.cause}, after {wanted.task}"
    board.report(Severity.INFO, f"contingency {wanted.task} {manoeuvre.program.state}; then {wanted.then}")
    mission = board.mission
    if wanted.then == "resume" and is_done and mission is not None and mission.state is ActionState.PAUSED:
        return True
    policy = answer(wanted)
    manoeuvres.apply(board, policy, cause, now_s)
    return False


def watch_link(board: Board, silent_s: float, now_s: float) -> None:
    """Evaluates the time since the last message from the station in control: planned, overdue or lost.

    The planned silence lasts until its end time, also if the holder is received meanwhile, perhaps only for a moment.
    It ends earlier if the holder is received after the mission has ended. A holder that is silent at the end time is
    overdue until received again.
    """
    after_s = board.policies.link_loss_after_s
    is_silent, planned = silent_s >= after_s, board.silence
    if planned is not None and now_s - board.kept_s >= KEEP_SILENCE_S:
        board.is_changed = True
    if planned is None:
        set_condition(board, PolicyCondition.LINK_LOST, is_silent, f"no message for {after_s:g} s", now_s)
    elif not is_silent:
        set_condition(board, PolicyCondition.OVERDUE, False, "", now_s)
        set_condition(board, PolicyCondition.LINK_LOST, False, "", now_s)
        if now_s >= planned.until_s or not _is_silence_going_on(board, planned):
            _end_silence(board)
    elif now_s >= planned.until_s:
        reason = f"contact was due {planned.until_s - planned.began_s:g} s after {planned.target} began"
        set_condition(board, PolicyCondition.OVERDUE, True, reason, now_s)


def _end_silence(board: Board) -> None:
    """Ends the planned silence: a lost link is a fault again."""
    if board.silence is not None:
        board.silence = None
        board.is_changed = True
        board.report(Severity.INFO, "the planned silence is over")


def restored_silence(kept: PlannedSilence | None, now_s: float) -> PlannedSilence | None:
    """Planned silence after a restart: never longer than stated, even if the clock has restarted."""
    if kept is None:
        return None
    stated_s = kept.until_s - kept.began_s
    until_s = min(kept.until_s, now_s + stated_s)
    return PlannedSilence(target=kept.target, began_s=until_s - stated_s, until_s=until_s)


def _is_silence_going_on(board: Board, planned: PlannedSilence) -> bool:
    """Whether the mission or single command that stated it is still running."""
    return any(program.is_open and program.find(planned.target) is not None for program in board.programs.values())
