"""Others who have control in place of the mission: a pilot, the autopilot's failsafe, an operator at the autopilot itself."""

from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import Cause
from gloc3.mission.executing import manoeuvres, reactions
from gloc3.mission.executing.board import BY_OPERATOR, SAFETY, UNATTENDED_S, Board
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ENDED_BY_FAILSAFE, ActionState, StateTrigger


def begin(board: Board, reason: str, now_s: float, *, is_failsafe: bool) -> None:
    """A pilot, or the autopilot's failsafe, has taken over: the mission pauses, single commands end."""
    board.has_pilot, board.is_failsafe, board.is_operator, board.is_changed = True, is_failsafe, False, True
    board.taken_over_s = now_s
    why = Cause.FAILSAFE if is_failsafe else Cause.PILOT
    with board.because(why):
        board.report(Severity.WARNING, f"{board.controller} has control: {reason}")
        manoeuvres.clear(board, now_s)
        for program in board.programs.values():
            if program.is_mission:
                board.halt(program, program.level, now_s, f"{why}: {reason}")
            else:
                manoeuvres.end_program(board, program, StateTrigger.ABORT, now_s, why)


def operated(board: Board, what: str, now_s: float) -> None:
    """An operator has commanded the autopilot itself, while this process was silent: its mode is no pilot's.

    The mission stays paused until an operator resumes it; the safety policies apply meanwhile.

    Args:
        board: what is executed.
        what: `station 255 sent return`.
        now_s: the time.
    """
    if board.is_failsafe:
        return
    board.report(Severity.NOTICE, f"{what} to the autopilot while this process was not heard: no pilot has control")
    mission = board.mission
    if board.has_pilot:
        board.is_operator = True
    elif mission is not None and mission.state is ActionState.RUNNING:
        manoeuvres.dismiss(board, now_s)
        board.halt(mission, mission.level, now_s, BY_OPERATOR)


def unattended(board: Board, silent_s: float, now_s: float, *, is_held: bool) -> None:
    """Nobody is there who could fly: the safety policies answer what waits for the end of the takeover.

    A vehicle that only holds has a time, too: it lands after a further `hold_s`.

    Args:
        board: what is executed.
        silent_s: how long nobody has been heard who may be the pilot.
        now_s: the time.
        is_held: whether the autopilot holds the vehicle, rather than that it is flown somewhere.
    """
    is_waiting = not SAFETY.isdisjoint(board.unanswered)
    is_over = is_held and board.is_airborne and silent_s >= UNATTENDED_S + board.policies.hold_s
    if not board.has_pilot or board.is_failsafe or not (is_waiting or is_over):
        return
    why = (
        "an operator commanded the autopilot, and no pilot has control"
        if board.is_operator
        else f"neither a transmitter nor another station was heard for {silent_s:.0f} s"
    )
    take_back(board)
    with board.because(Cause.PILOT):
        board.report(Severity.WARNING, f"{why}: the mission's policies apply")
        reactions.answer_waiting(board, now_s)
        if is_over:
            manoeuvres.apply(board, Policy.LAND, "held, and nobody in charge", now_s)


def failsafe_holds(board: Board, now_s: float) -> None:
    """Changes to the policy hold when the autopilot's failsafe holds the vehicle and no pilot has control."""
    take_back(board)
    with board.because(Cause.FAILSAFE):
        manoeuvres.apply(board, Policy.HOLD, "held by the autopilot's failsafe", now_s)
    reactions.answer_waiting(board, now_s)


def failsafe_landed(board: Board, now_s: float) -> None:
    """Ends all programs after the autopilot's failsafe has landed and disarmed the vehicle."""
    for program in board.programs.values():
        manoeuvres.end_program(board, program, StateTrigger.ABORT, now_s, ENDED_BY_FAILSAFE)
    board.lost.clear()
    take_back(board)


def take_back(board: Board) -> None:
    """Control is ours again; the driver is told."""
    board.has_pilot = board.is_failsafe = board.is_operator = False
    board.is_taking_back = board.is_changed = True
