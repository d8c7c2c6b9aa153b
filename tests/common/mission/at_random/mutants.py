"""Executors with one thing broken each, to see whether the observer finds it."""

import inspect
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from gloc3.mission.checking import space_check
from gloc3.mission.executing import failures, flow, manoeuvres, reactions, restore, takeovers
from gloc3.mission.executing.assignments import Assignments
from gloc3.mission.executing.board import Board
from gloc3.mission.executing.executor import MissionExecutor


class Mutant(NamedTuple):
    """A change of one line."""

    name: str
    function: Callable[..., Any]
    old: str
    new: str
    seed: int = 0
    """From which on missions are drawn until one shows it; there it does not take long."""


MUTANTS = (
    Mutant(
        "an action does not wait for its siblings",
        flow._start_action,
        "not all(siblings[name].has_ended for name in run.options.after)",
        "False",
    ),
    Mutant(
        "a task does not wait for others",
        flow._go_on,
        "all(program.tasks[name].has_ended for name in task.options.after)",
        "True",
    ),
    Mutant("claims are not looked at", Assignments.holder, "if name in self.claims", "if False", seed=25),
    Mutant("deadlines of actions are forgotten", flow._watch, "if now_s >= run.due_s():", "if False:", seed=97),
    Mutant("deadlines of tasks are forgotten", flow._watch, "if now_s >= task.due_s():", "if False:", seed=45),
    Mutant("moves are not put on disk", Board.move, "self.is_changed = True", "pass"),
    Mutant("a restart forgets the states", restore._bring_back, "item.restore(kept.items[item.target], now_s)", "pass"),
    Mutant("a restart begins to count anew", restore.restore, "count = snapshot.count", "count = 0"),
    Mutant("a pause does not reach the component", Board.halt, "self.assignments.pause(assignment, now_s)", "pass"),
    Mutant("what is ended goes on at its component", Board.release, "self.assignments.drop", "(lambda *_, **__: None)"),
    Mutant("attempts never end", failures._fail_action, "if run.has_attempts_left:", "if True:", seed=30),
    Mutant("failures have no consequence", failures._manoeuvre, "manoeuvres.apply(", "(lambda *_: None)(", seed=24),
    Mutant("a milder policy wins", manoeuvres.apply, "SEVERITY[current.policy] >= SEVERITY[policy]", "False", seed=72),
    Mutant(
        "a pilot is not noticed",
        takeovers.begin,
        "board.has_pilot, board.is_failsafe, board.is_operator, board.is_changed = True, is_failsafe, False, True",
        "pass",
        seed=42,
    ),
    Mutant("the owner of motion is not told", Assignments.collect, "if grant != self._granted:", "if False:"),
    Mutant("progress is not put on disk", MissionExecutor._note_progress, "self.board.is_changed = True", "pass"),
    Mutant(
        "the fence is not looked at",
        space_check._fence,
        "clearance_m = fence",
        "return\n    clearance_m = fence",
        seed=62,
    ),
    Mutant("guards are not looked at", flow.guard_decision, "if guard is None:", "if True:", seed=44),
    Mutant(
        "a loop is done once too often",
        flow.is_to_repeat,
        "task.repetition >= repeat.times",
        "task.repetition > repeat.times",
        seed=16,
    ),
    Mutant(
        "the mission runs on beside a contingency",
        reactions.begin_contingency,
        'board.halt(program, "mission", now_s, reason)',
        "pass",
        seed=72,
    ),
    Mutant(
        "what follows a contingency is left out",
        reactions.end_contingency,
        "manoeuvres.apply(board, policy, cause, now_s)",
        "pass",
        seed=140,
    ),
    Mutant(
        "the mission does not go on after a contingency",
        reactions.end_contingency,
        "return True",
        "return False",
        seed=72,
    ),
)


@contextmanager
def broken(mutant: Mutant) -> Iterator[None]:
    """While it lasts, everybody who calls the function gets the broken one."""
    function: Any = mutant.function
    source = textwrap.dedent(inspect.getsource(function))
    assert source.count(mutant.old) == 1, f"{mutant.old!r} is not what the function says any more"
    made: dict[str, Any] = {}
    exec(source.replace(mutant.old, mutant.new), function.__globals__, made)
    whole = function.__code__
    function.__code__ = made[function.__name__].__code__
    try:
        yield
    finally:
        function.__code__ = whole
