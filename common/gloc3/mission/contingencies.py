"""Contingencies: tasks that a mission has ready for when something befalls the vehicle, and what follows them.

One runs in the place of a policy's manoeuvre: the mission is paused meanwhile, and no less severe policy interrupts it.
"""

from dataclasses import replace
from typing import Final

from msgspec import structs

from gloc3.messages import Severity
from gloc3.mission import manoeuvres
from gloc3.mission.board import Board, Manoeuvre
from gloc3.mission.items import Program
from gloc3.mission.model import Contingency, Mission, answer
from gloc3.mission.policy import SEVERITY, Policy
from gloc3.mission.states import ActionState, Trigger

CONTINGENCY: Final = "contingency"
"""The name of the program that is a contingency under way."""


def part_of(mission: Mission, name: str) -> Mission:
    """One contingency of a mission as a mission of its own, in which a failure ends nothing but the action."""
    task = mission.contingencies[name]
    return replace(
        mission,
        tasks={name: replace(task, options=structs.replace(task.options, after=()))},
        contingencies={},
        deadline_s=None,
        policies=structs.replace(mission.policies, on_failure=Policy.CONTINUE),
        document=mission.document.seen_as("tasks", "contingencies") if mission.document is not None else None,
    )


def begin(board: Board, wanted: Contingency, cause: str, now_s: float) -> bool:
    """Has a contingency run.

    Returns:
        Whether it was answered: it runs, or something more severe is under way. If not, its `then` is to be done.
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
            manoeuvres.end_program(board, program, Trigger.ABORT, now_s, reason)
    program = board.program(CONTINGENCY, part_of(mission.mission, wanted.task))
    board.manoeuvre = take_up(program, wanted, cause)
    board.tell(Severity.WARNING, f"contingency {wanted.task}: {cause}")
    board.move(program, Trigger.START, now_s)
    return True


def take_up(program: Program, wanted: Contingency, cause: str) -> Manoeuvre:
    """The contingency as what is being carried out."""
    manoeuvre = Manoeuvre(answer(wanted), cause)
    manoeuvre.contingency, manoeuvre.program = wanted, program
    return manoeuvre


def has_ended(board: Board) -> bool:
    """Whether the contingency that was under way has ended."""
    manoeuvre = board.manoeuvre
    return manoeuvre is not None and manoeuvre.program is not None and not manoeuvre.program.is_open


def follow(board: Board, now_s: float) -> bool:
    """Does what comes after a contingency that has ended; whether the mission is to go on where it was paused."""
    manoeuvre = board.manoeuvre
    assert manoeuvre is not None
    assert manoeuvre.contingency is not None
    assert manoeuvre.program is not None
    wanted, is_done = manoeuvre.contingency, manoeuvre.program.state is ActionState.DONE
    board.manoeuvre, board.is_changed = None, True
    cause = f"{manoeuvre.cause}, after {wanted.task}"
    board.tell(Severity.INFO, f"contingency {wanted.task} {manoeuvre.program.state}; then {wanted.then}")
    mission = board.mission
    if wanted.then == "resume" and is_done and mission is not None and mission.state is ActionState.PAUSED:
        return True
    policy = answer(wanted)
    manoeuvres.apply(board, policy, cause, now_s)
    return False
