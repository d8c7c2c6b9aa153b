"""Missions across platforms: the other platforms' reported states, and the reaction to a loss.

Every platform has the whole file and performs its own tasks. Of another platform's task only the state is known here.
"""

from collections.abc import Mapping
from math import inf
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.mission.executing import reactions
from gloc3.mission.executing.board import Board, OtherPlatform, PolicyCondition
from gloc3.mission.executing.items import MissionProgram
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState, StateTrigger

GIVEN_UP: Final = (ActionState.FAILED, ActionState.ABORTED)
"""States of a platform's mission in which its tasks that are left never end."""
TAKING_PART: Final = (ActionState.WAITING, ActionState.RUNNING, ActionState.PAUSED)
"""States that show that a platform takes part in this run of the mission: it has loaded it, and not ended it."""


def expect(board: Board, program: MissionProgram, now_s: float) -> None:
    """Starts the loss timeout of the other platforms, as the mission begins or resumes."""
    board.others = {name: OtherPlatform(now_s) for name in program.others}


def reported(board: Board, name: str, state: ActionState, tasks: Mapping[str, ActionState], now_s: float) -> None:
    """Handles a report on another platform's part of the loaded mission.

    The text is the same in each run of a mission: until the platform is seen to take part, its mission has ended in an
    earlier run, and nothing of it counts.

    Args:
        board: the executor's state.
        name: the other platform.
        state: of its mission.
        tasks: its tasks' states.
        now_s: the time.
    """
    program = board.mission
    if program is None or name not in program.others:
        return
    other = board.others.setdefault(name, OtherPlatform(now_s))
    if name not in program.joined and state not in TAKING_PART:
        other.earlier = state
        return
    if name not in program.joined:
        program.joined.add(name)
        board.is_changed = True
    other.received_s, other.state, other.earlier = now_s, state, None
    has_given_up = state in GIVEN_UP
    for task in program.tasks.values():
        if task.elsewhere != name or task.target not in tasks:
            continue
        found, reason = tasks[task.target], ""
        if has_given_up and found in GIVEN_UP:
            found, reason = ActionState.FAILED, f"the mission of {name} is {state}"
        is_settled = found is ActionState.FAILED and not has_given_up and state is not ActionState.PAUSED
        if task.adopt(found, reason, is_settled=is_settled):
            board.is_changed = True


def watch(board: Board, now_s: float) -> None:
    """Detects when other platforms that tasks here wait for are lost, or are back."""
    program = board.mission
    lost = _lost(board, program, now_s) if program is not None and program.is_open else {}
    for name, other in board.others.items():
        other.is_lost = other.is_lost and name in lost
    if not lost and PolicyCondition.PLATFORM_LOST in board.conditions:
        del board.conditions[PolicyCondition.PLATFORM_LOST]
        board.unanswered.pop(PolicyCondition.PLATFORM_LOST, None)
        board.report(Severity.INFO, f"{PolicyCondition.PLATFORM_LOST}: over")
    new = {name: reason for name, reason in lost.items() if not board.others[name].is_lost}
    if program is not None and new and program.state is ActionState.RUNNING:
        _react(board, program, new, now_s)


def _react(board: Board, program: MissionProgram, new: Mapping[str, str], now_s: float) -> None:
    """Carries out the policy, once for each loss."""
    reason = ", ".join(new.values())
    for name in new:
        board.others[name].is_lost = True
    board.conditions[PolicyCondition.PLATFORM_LOST] = reason
    with board.because(PolicyCondition.PLATFORM_LOST.cause):
        reactions.apply_policy(board, PolicyCondition.PLATFORM_LOST, reason, now_s)
    if Policy(board.policies.on_platform_loss) is Policy.SKIP and not board.has_pilot:
        _leave_out(board, program, new, now_s)


def due_s(board: Board) -> float:
    """When another platform counts as lost without a further report."""
    program = board.mission
    if program is None or program.state is not ActionState.RUNNING:
        return inf
    others = [board.others[name] for name in program.awaited() if name in board.others]
    received = [other.received_s for other in others if not other.is_lost]
    return min(received, default=inf) + board.policies.platform_loss_after_s


def _lost(board: Board, program: MissionProgram, now_s: float) -> dict[str, str]:
    """The lost platforms that are waited for, each with the reason."""
    lost: dict[str, str] = {}
    for name in program.awaited():
        other = board.others.get(name)
        if other is None:
            continue
        if other.state in GIVEN_UP:
            lost[name] = f"{name}: its mission is {other.state}"
        elif now_s >= other.received_s + board.policies.platform_loss_after_s:
            reason = f"no report for {board.policies.platform_loss_after_s:g} s"
            if other.earlier is not None:
                reason = f"its mission is {other.earlier} from an earlier run; start it there, or skip its tasks here"
            lost[name] = f"{name}: {reason}"
    return lost


def _leave_out(board: Board, program: MissionProgram, lost: Mapping[str, str], now_s: float) -> None:
    awaited = program.awaited()
    for name, reason in lost.items():
        for task in awaited.get(name, ()):
            if not task.has_ended:
                board.move(task, StateTrigger.SKIP, now_s, reason)
