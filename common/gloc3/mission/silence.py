"""Planned silence: from the start of a task or action on, a lost link is no fault until the stated time has passed."""

from typing import Final

from gloc3.messages import Severity
from gloc3.mission import reactions
from gloc3.mission.board import Board, Condition
from gloc3.mission.snapshot import PlannedSilence

KEEP_S: Final = 30.0
"""While a silence is planned it is kept on disk so often how far it has come, for restarts of the computer."""


def look(board: Board, silent_s: float, now_s: float) -> None:
    """Judges for how long nothing was heard from the holder of control: as planned, overdue, or a lost link.

    The silence lasts until its time, also where the holder is heard meanwhile: he may be heard only for a moment. It ends
    before when he is heard after the mission has ended. Who is silent at its time is overdue until he is heard.
    """
    after_s = board.policies.link_loss_after_s
    is_silent, planned = silent_s >= after_s, board.silence
    if planned is not None and now_s - board.kept_s >= KEEP_S:
        board.is_changed = True
    if planned is None:
        _set(board, Condition.LINK_LOST, is_silent, f"nothing heard for {after_s:g} s", now_s)
    elif not is_silent:
        _set(board, Condition.OVERDUE, False, "", now_s)
        _set(board, Condition.LINK_LOST, False, "", now_s)
        if now_s >= planned.until_s or not _goes_on(board, planned):
            end(board)
    elif now_s >= planned.until_s:
        reason = f"contact was due {planned.until_s - planned.began_s:g} s after {planned.target} began"
        _set(board, Condition.OVERDUE, True, reason, now_s)


def end(board: Board) -> None:
    """From now on a lost link is a fault again."""
    if board.silence is not None:
        board.silence = None
        board.is_changed = True
        board.tell(Severity.INFO, "the planned silence is over")


def restored(kept: PlannedSilence | None, now_s: float) -> PlannedSilence | None:
    """What was kept, after a restart: never longer than it was stated, even where the clock has begun anew."""
    if kept is None:
        return None
    stated_s = kept.until_s - kept.began_s
    until_s = min(kept.until_s, now_s + stated_s)
    return PlannedSilence(target=kept.target, began_s=until_s - stated_s, until_s=until_s)


def _goes_on(board: Board, planned: PlannedSilence) -> bool:
    """Whether the mission, or the single command, that stated it goes on."""
    return any(program.is_open and program.find(planned.target) is not None for program in board.programs.values())


def _set(board: Board, condition: Condition, is_on: bool, reason: str, now_s: float) -> None:
    reactions.set_condition(board, condition, is_on, reason, now_s)
