"""Another text in place of the running mission's, while it runs: tasks are added, taken away or given to other platforms."""

from dataclasses import replace

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3.mission.executing import flow
from gloc3.mission.executing.board import Board, OtherPlatform
from gloc3.mission.executing.items import MISSION, ActionRun, MissionProgram, TaskRun
from gloc3.mission.model.model import Mission, Task
from gloc3.mission.model.states import ActionState


def amend(board: Board, mission: Mission, now_s: float) -> None:
    """Continues the running mission by another text; what has begun goes on undisturbed.

    Args:
        board: the executor's state.
        mission: the new text, checked. Tasks that have begun are in it as they were, with the same platform.
        now_s: the time.

    Raises:
        Refused: it cannot continue so; nothing has changed.
    """
    old = running(board)
    _refuse_changes(old, mission)
    kept = {name: replace(mission.tasks[name], actions=old.mission.tasks[name].actions) for name in begun(old)}
    new = MissionProgram(MISSION, replace(mission, tasks={**mission.tasks, **kept}), board.rows)
    new.restore(old.snapshot(now_s), now_s)
    for item in new.items():
        if (was := _kept(item, old)) is not None:
            item.restore(was.snapshot(now_s), now_s)
        if isinstance(item, ActionRun) and isinstance(was, ActionRun):
            item.action_id, item.unavailable_since_s = was.action_id, was.unavailable_since_s
    _refuse_disorder(new)
    flow.make_room(board, mission, [program for program in board.programs.values() if program is not old])
    for assignment in board.assignments.by_id.values():
        if assignment.run is not None and assignment.run.task.program is old:
            found = new.find(assignment.run.target)
            assert isinstance(found, ActionRun)
            assignment.run = found
    board.programs[MISSION] = new
    board.policies = mission.policies
    board.others = {name: board.others.get(name, OtherPlatform(now_s)) for name in new.others}
    board.is_changed = True
    ours = {task.target for task in new.own_tasks}
    added = [name for name in ours if (was := old.tasks.get(name)) is None or was.elsewhere]
    left = [task.target for task in old.own_tasks if task.target not in ours]
    changes = [f"with {', '.join(sorted(added))}"] if added else []
    changes += [f"without {', '.join(sorted(left))}"] if left else []
    board.report(Severity.NOTICE, f"the mission goes on {' and '.join(changes) or 'by another text'}")


def running(board: Board) -> MissionProgram:
    """The mission that can be amended now.

    Raises:
        Refused: none can.
    """
    program = board.mission
    if program is None or not program.is_open:
        raise Refused("no mission is running")
    if board.has_pilot:
        raise Refused(f"{board.controller} has control")
    if board.manoeuvre is not None:
        raise Refused(f"the policy {board.manoeuvre.policy} is being carried out ({board.manoeuvre.cause})")
    return program


def begun(program: MissionProgram) -> frozenset[str]:
    """This platform's tasks that have begun or ended, those included that wait for another attempt."""
    tasks = program.own_tasks
    return frozenset(task.target for task in tasks if task.state is not ActionState.WAITING or task.starts)


def _kept(item: TaskRun | ActionRun, old: MissionProgram) -> TaskRun | ActionRun | None:
    """The same item as it was; None for one that is new here."""
    was = old.find(item.target)
    return was if was is not None and _performer(was) == _performer(item) else None


def _performer(item: TaskRun | ActionRun) -> str:
    return item.elsewhere if isinstance(item, TaskRun) else item.task.elsewhere


def _refuse_changes(old: MissionProgram, mission: Mission) -> None:
    before = old.mission
    for what in ("frame", "height_above", "geofence"):
        if getattr(before, what) != getattr(mission, what):
            raise Refused(f"the {what.replace('_', ' ')} of a running mission cannot be changed")
    for name in begun(old):
        task = mission.tasks.get(name)
        if task is None or task.is_elsewhere:
            raise Refused(f"{name} has begun: it cannot be left out, or given to another platform")
        if _as_written(task) != _as_written(before.tasks[name]):
            raise Refused(f"{name} has begun: its actions cannot be changed")


def _as_written(task: Task) -> dict[str, tuple[object, ...]]:
    """The actions of a task without what is known of the vehicle's place, which is not the same after a while."""
    return {name: (one.capability, one.arguments, one.options) for name, one in task.actions.items()}


def _refuse_disorder(program: MissionProgram) -> None:
    """Nothing that has begun comes after something that has not ended."""
    for name in begun(program):
        for before in program.tasks[name].options.after:
            if not program.tasks[before].has_ended:
                raise Refused(f"{name} has begun, and would come after {before}")
