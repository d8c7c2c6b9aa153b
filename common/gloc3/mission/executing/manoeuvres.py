"""Carries out the policies that move the vehicle: hold, return, land; the most severe of several wins."""

from math import inf
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.mission.executing.assignments import Assignment
from gloc3.mission.executing.board import Board, PolicyManoeuvre
from gloc3.mission.executing.items import MissionProgram
from gloc3.mission.model.arguments import Arguments, LandOrder, ReturnHome
from gloc3.mission.model.policy import SEVERITY, Policy
from gloc3.mission.model.states import ENDED, ActionState, StateTrigger

AGAIN_S: Final = 1.0
"""Interval between attempts of a landing that cannot be started, without a limit on their number, s."""
DIRECT_S: Final = 3.0
"""After so long without the components that land, the autopilot is asked for its own landing directly."""
TIMEOUT_S: Final = 5.0
"""How long a return waits for a lost requirement, s: a component is started three times meanwhile. Then it becomes a landing
in place."""

_CAPABILITY: Final[dict[Policy, tuple[str, Arguments]]] = {
    Policy.RETURN: ("return_home", ReturnHome()),
    Policy.LAND: ("land", LandOrder()),
}


def apply(
    board: Board,
    policy: Policy,
    cause: str,
    now_s: float,
    trigger: StateTrigger = StateTrigger.FAIL,
    *,
    is_ordered: bool = False,
) -> None:
    """Executes `hold`, `return` or `land`, unless a more severe policy is active.

    Args:
        board: the executor's state.
        policy: the policy.
        cause: the reason.
        now_s: the time.
        trigger: state of a mission ended by a return or landing: failed or aborted.
        is_ordered: requested by an operator: it takes precedence over any policy, and a hold has no time limit.
    """
    current = board.manoeuvre
    if current is not None and not is_ordered and SEVERITY[current.policy] >= SEVERITY[policy]:
        return
    stop(board, now_s)
    reason = f"{cause}: {policy}"
    if policy is Policy.HOLD:
        for program in board.programs.values():
            if program.is_mission:
                board.halt(program, "mission", now_s, reason)
            elif _is_stopped_by_hold(program):
                end_program(board, program, StateTrigger.ABORT, now_s, reason)
    else:
        for program in board.programs.values():
            end_program(board, program, trigger if program.is_mission else StateTrigger.ABORT, now_s, reason)
    if not board.is_airborne:
        return
    board.manoeuvre = PolicyManoeuvre(policy, cause)
    board.is_changed = True
    board.report(Severity.WARNING, f"policy {policy}: {cause}")
    if policy is Policy.HOLD:
        board.manoeuvre.land_at_s = None if is_ordered else now_s + board.policies.hold_s
    else:
        board.manoeuvre.again_s = now_s


def continue_policy(board: Board, policy: Policy, cause: str, land_at_s: float | None, now_s: float) -> None:
    """Continues the policy from before a restart; the restart does not prolong a hold.

    Args:
        board: the executor's state.
        policy: the policy.
        cause: the reason.
        land_at_s: for a hold, when it ends in a landing, by a clock that may have restarted since; None where an
            operator requested it.
        now_s: the time.
    """
    apply(board, policy, cause, now_s)
    if policy is Policy.HOLD and board.manoeuvre is not None:
        limit_s = now_s + board.policies.hold_s
        board.manoeuvre.land_at_s = None if land_at_s is None else min(land_at_s, limit_s)


def _is_stopped_by_hold(program: MissionProgram) -> bool:
    """Whether a single command moves the vehicle, or has failed."""
    return any(
        (run.is_motion and not run.has_ended) or (run.state is ActionState.FAILED and not run.is_settled)
        for run in program.actions()
    )


def end_program(board: Board, program: MissionProgram, trigger: StateTrigger, now_s: float, reason: str) -> None:
    """Ends a running program with all its items."""
    if program.is_open:
        board.end_all(program, StateTrigger.ABORT, now_s, reason)
        board.move(program, trigger, now_s, reason)


def stop(board: Board, now_s: float) -> None:
    """Ends the policy that is being carried out, or the contingency."""
    if board.manoeuvre is not None:
        if board.manoeuvre.program is not None:
            end_program(board, board.manoeuvre.program, StateTrigger.ABORT, now_s, "superseded")
        if board.manoeuvre.assignment is not None:
            board.assignments.drop(board.manoeuvre.assignment)
        board.manoeuvre = None
        board.is_changed = True


def dismiss(board: Board, now_s: float) -> None:
    """Ends a policy's hold because an operator acts; the hold controller keeps the vehicle until it continues."""
    manoeuvre = board.manoeuvre
    if manoeuvre is not None and manoeuvre.policy is Policy.HOLD and manoeuvre.program is None:
        stop(board, now_s)


def clear(board: Board, now_s: float) -> None:
    """Ends whatever policy is being carried out, because a pilot has control."""
    stop(board, now_s)


def advance(board: Board, now_s: float) -> None:
    """Starts the manoeuvre's next action, or lands after a hold without an operator's action."""
    manoeuvre = board.manoeuvre
    if manoeuvre is None or manoeuvre.program is not None:
        return
    if not board.is_airborne and manoeuvre.assignment is None:
        board.report(Severity.INFO, f"policy {manoeuvre.policy} ended: the vehicle is on the ground")
        stop(board, now_s)
    elif manoeuvre.land_at_s is not None and now_s >= manoeuvre.land_at_s:
        cause = f"{manoeuvre.cause}; no operator command for {board.policies.hold_s:g} s"
        apply(board, Policy.LAND, cause, now_s)
        advance(board, now_s)
    elif manoeuvre.assignment is not None and now_s >= lost_at_s(board):
        board.assignments.drop(manoeuvre.assignment)
        manoeuvre.assignment = None
        missing = board.missing.words("return_home")
        _fall_back(board, manoeuvre, f"return_home is no longer available ({missing})", now_s)
    elif manoeuvre.again_s is not None and manoeuvre.assignment is None:
        name, order = _CAPABILITY[manoeuvre.policy]
        row = board.rows.get(name)
        if manoeuvre.policy is Policy.RETURN and row is not None:  # who performs it may come back in a moment
            manoeuvre.again_s = board.missing.since_s.get(name, -inf) + TIMEOUT_S
        if now_s < manoeuvre.again_s:
            return
        manoeuvre.again_s = None
        if row is None or name in board.missing:
            missing = board.missing.words(name) or "the platform cannot do it"
            _fall_back(board, manoeuvre, f"{name} is not available ({missing})", now_s)
            return
        board.is_changed = True
        manoeuvre.assignment = board.assignments.start(f"policy.{name}", name, row, order, None, now_s)


def lost_at_s(board: Board) -> float:
    """When the current return is given up for lack of a requirement; infinite if it lacks none."""
    manoeuvre = board.manoeuvre
    if manoeuvre is None or manoeuvre.assignment is None or manoeuvre.policy is not Policy.RETURN:
        return inf
    return board.missing.since_s.get("return_home", inf) + TIMEOUT_S


def ended(board: Board, assignment: Assignment, state: ActionState, reason: str, now_s: float) -> None:
    """Handles the end or failure of a manoeuvre's action."""
    manoeuvre = board.manoeuvre
    if manoeuvre is None or manoeuvre.assignment is not assignment or state not in ENDED:
        return
    manoeuvre.assignment = None
    board.is_changed = True
    if manoeuvre.policy is Policy.RETURN and state is not ActionState.DONE and "return_home" in board.missing:
        manoeuvre.again_s = now_s
    elif state is not ActionState.DONE:
        _fall_back(board, manoeuvre, f"{assignment.label} {state}: {reason}", now_s)
    elif manoeuvre.policy is Policy.RETURN:
        board.report(Severity.INFO, "policy return: at home, landing")
        manoeuvre.policy, manoeuvre.again_s = Policy.LAND, now_s
    else:
        board.air.land()
        board.report(Severity.INFO, "policy land: landed")
        board.manoeuvre = None


def _fall_back(board: Board, manoeuvre: PolicyManoeuvre, reason: str, now_s: float) -> None:
    """From return to landing here; from landing to landing again."""
    if manoeuvre.policy is Policy.RETURN:
        board.report(Severity.ERROR, f"{reason}; landing here")
        manoeuvre.policy, manoeuvre.again_s = Policy.LAND, now_s
        advance(board, now_s)
    else:
        if reason != manoeuvre.problem:
            manoeuvre.problem = reason
            board.report(Severity.ERROR, f"{reason}; trying again")
        manoeuvre.again_s = now_s + AGAIN_S
