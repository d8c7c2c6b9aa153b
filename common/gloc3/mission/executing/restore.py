"""Brings the executor back after its process ended: progress from disk, then the `on_restart` policy."""

from collections.abc import Callable

from gloc3.errors import InputError
from gloc3.messages.envelope import Severity
from gloc3.mission.executing import elsewhere, flow, manoeuvres
from gloc3.mission.executing.board import Board
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.executing.items import ActionRun, MissionProgram
from gloc3.mission.executing.reactions import (
    CONTINGENCY,
    contingency_manoeuvre,
    finish_interrupted,
    left_in_restart,
    restored_silence,
)
from gloc3.mission.executing.snapshot import ProgramSnapshot, Snapshot
from gloc3.mission.model.arguments import LandOrder, SetOff
from gloc3.mission.model.model import Mission, part_of
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import RESTART, ActionState, StateTrigger
from gloc3.platform.platform import Platform


def restore(
    platform: Platform, snapshot: Snapshot, read: Callable[[str], Mission], is_airborne: bool, now_s: float
) -> MissionExecutor:
    """Creates an executor that continues from a snapshot.

    In the air the mission's `on_restart` is executed; on the ground the mission waits, paused, for an operator: a
    restart never arms the vehicle. Single commands are not resumed. A pilot who had control keeps it.

    Args:
        platform: the platform.
        snapshot: the last persisted state.
        read: parses a mission that was checked before.
        is_airborne: whether the vehicle is in the air.
        now_s: the time.
    """
    executor = MissionExecutor(platform)
    board = executor.board
    board.assignments.count = snapshot.count
    board.air.is_reported = is_airborne
    for kept in snapshot.programs:
        try:
            program = board.program(kept.name, _read_again(read, kept))
        except InputError as error:
            board.report(Severity.ERROR, f"after the restart {kept.name} cannot be read: {error.findings[0]}")
            continue
        _bring_back(program, kept, now_s)
        finish_interrupted(board, program, SetOff if is_airborne else LandOrder, now_s)
        if program.is_mission:
            board.policies = program.mission.policies
            elsewhere.expect(board, program, now_s)
        elif kept.name == CONTINGENCY and _goes_on(board, snapshot, is_airborne):
            assert snapshot.contingency is not None
            board.manoeuvre = contingency_manoeuvre(program, snapshot.contingency, snapshot.cause)
        elif program.is_open:
            board.end_all(program, StateTrigger.ABORT, now_s, RESTART)
            board.move(program, StateTrigger.ABORT, now_s, RESTART)
    board.silence = restored_silence(snapshot.silence, now_s)
    mission = board.mission
    if snapshot.has_pilot:
        board.lost.update(snapshot.lost)
        executor.pilot(True, f"as before the {RESTART}", now_s)
    elif board.manoeuvre is not None and board.manoeuvre.program is not None:
        _continue_policy(executor, board.manoeuvre.program, now_s)
    elif snapshot.policy is not None and is_airborne:
        cause = snapshot.cause.removesuffix(f", {RESTART}")
        manoeuvres.continue_policy(board, snapshot.policy, f"{cause}, {RESTART}", snapshot.land_at_s, now_s)
    elif mission is not None and mission.is_open:
        _go_on(executor, mission, is_airborne, now_s)
    elif is_airborne and any(kept.own.state is ActionState.RUNNING for kept in snapshot.programs):
        manoeuvres.apply(board, Policy.HOLD, RESTART, now_s)
    executor.settle(now_s)
    return executor


def _read_again(read: Callable[[str], Mission], kept: ProgramSnapshot) -> Mission:
    """The mission of a program; an earlier process may have kept a single command under a contingency's name."""
    mission = read(kept.text)
    task = next((name for name in kept.items if kept.name == CONTINGENCY and "." not in name), "")
    return part_of(mission, task) if task in mission.contingencies else mission


def _goes_on(board: Board, snapshot: Snapshot, is_airborne: bool) -> bool:
    """Whether an active contingency is resumed; if not, its follow-up is applied."""
    is_wanted = snapshot.contingency is not None and not snapshot.has_pilot
    return is_wanted and is_airborne and Policy(board.policies.on_restart) is Policy.CONTINUE


def _continue_policy(executor: MissionExecutor, contingency: MissionProgram, now_s: float) -> None:
    executor.board.report(Severity.WARNING, "restart in flight: the contingency goes on")
    for run in contingency.actions():
        if run.paused_by == RESTART and run.state is ActionState.PAUSED:
            flow.go_on_after_pause(executor.board, run, now_s)


def _bring_back(program: MissionProgram, kept: ProgramSnapshot, now_s: float) -> None:
    """Restores the states; running items are paused, because no component performs them any more."""
    program.restore(kept.own, now_s)
    for item in program.items():
        if item.target in kept.items:
            item.restore(kept.items[item.target], now_s)
        if isinstance(item, ActionRun) and item.state is ActionState.RUNNING:
            item.move(StateTrigger.PAUSE, now_s, RESTART)
            item.paused_by = RESTART


def _go_on(executor: MissionExecutor, mission: MissionProgram, is_airborne: bool, now_s: float) -> None:
    board = executor.board
    interrupted = [run for run in mission.actions() if run.paused_by == RESTART]
    if is_airborne and mission.state is ActionState.RUNNING and Policy(board.policies.on_restart) is Policy.CONTINUE:
        board.report(Severity.WARNING, "restart in flight: the mission goes on")
        for run in interrupted:
            if run.state is ActionState.PAUSED:
                flow.go_on_after_pause(board, run, now_s)
        return
    for run in interrupted:
        run.paused_by = mission.level if run.state is ActionState.PAUSED else run.paused_by
    if is_airborne and (mission.state is ActionState.RUNNING or mission.reason == RESTART):
        left_in_restart(board, f"{RESTART} in flight", now_s)
    else:
        board.halt(mission, mission.level, now_s, RESTART)
