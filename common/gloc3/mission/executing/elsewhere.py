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


def expect(board: Board, program: MissionProgram, now_s: float) -> None:
    """Starts the loss timeout of the other platforms, as the mission begins or resumes."""
    board.others = {name: OtherPlatform(now_s) for name in program.others}


def reported(board: Board, name: str, state: ActionState, tasks: Mapping[str, ActionState], now_s: float) -> None:
    """Handles a report on another platform's part of the loaded mission.

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
    other.received_s, other.state = now_s, state
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
    """Detects when another platform that tasks here wait for is lost, or is back."""
    program = board.mission
    lost = "" if program is None or not program.is_open else _lost(board, program, now_s)
    if (was := board.conditions.get(PolicyCondition.PLATFORM_LOST)) is not None and not lost:
        del board.conditions[PolicyCondition.PLATFORM_LOST]
        board.unanswered.pop(PolicyCondition.PLATFORM_LOST, None)
        board.report(Severity.INFO, f"{PolicyCondition.PLATFORM_LOST}: over")
    elif program is not None and lost and was is None and program.state is ActionState.RUNNING:
        board.conditions[PolicyCondition.PLATFORM_LOST] = lost
        with board.because(PolicyCondition.PLATFORM_LOST.cause):
            reactions.apply_policy(board, PolicyCondition.PLATFORM_LOST, lost, now_s)
        if Policy(board.policies.on_platform_loss) is Policy.SKIP and not board.has_pilot:
            _leave_out(board, program, lost, now_s)


def due_s(board: Board) -> float:
    """When another platform counts as lost without a further report."""
    program = board.mission
    if program is None or program.state is not ActionState.RUNNING or PolicyCondition.PLATFORM_LOST in board.conditions:
        return inf
    received = [board.others[name].received_s for name in program.awaited() if name in board.others]
    return min(received, default=inf) + board.policies.platform_loss_after_s


def _lost(board: Board, program: MissionProgram, now_s: float) -> str:
    """Which platform is lost, and why; empty where none is that is waited for."""
    for name in program.awaited():
        other = board.others.get(name)
        if other is None:
            continue
        if other.state in GIVEN_UP:
            return f"{name}: its mission is {other.state}"
        if now_s >= other.received_s + board.policies.platform_loss_after_s:
            return f"{name}: no report for {board.policies.platform_loss_after_s:g} s"
    return ""


def _leave_out(board: Board, program: MissionProgram, lost: str, now_s: float) -> None:
    for task in program.awaited().get(lost.partition(":")[0], ()):
        if not task.has_ended:
            board.move(task, StateTrigger.SKIP, now_s, lost)
