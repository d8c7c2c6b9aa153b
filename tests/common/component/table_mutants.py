"""All single-cell mutations of the state table, run against the scenarios and the reviewed drawing.

Run it with `python -m tests.common.component.table_mutants`: it prints how many of how many are caught.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import permutations
from pathlib import Path
from typing import Final, NamedTuple

from tests.common.component import table_scenarios

from gloc3.component import lci
from gloc3.component.lci import TABLE, Command, State, Transition

DRAWING: Final = Path(__file__).parents[3] / "docs" / "states.md"

METHODS: Final = ("initialize", "start", "goquiet", "resume", "stop", "finish")
TARGETS: Final = (*State, None)


class Mutant(NamedTuple):
    """The table with one cell changed."""

    state: State
    command: Command
    cell: Transition | None
    """What stands there instead; None: nothing."""

    def __str__(self) -> str:
        now = "refused" if self.cell is None else f"{'+'.join(self.cell.methods) or 'nothing'} -> {self.cell.to}"
        return f"{self.command} in {self.state}: {now}"


class Score(NamedTuple):
    """How many mutants there were, and who caught them."""

    mutants: int
    by_scenarios: int
    by_drawing: int
    survivors: list[str]
    """Those that nobody caught."""

    def __str__(self) -> str:
        return (
            f"{self.mutants} single-cell mutants of the state table: {self.by_scenarios} caught by the scenarios under "
            f"the host, {self.by_drawing} by the reviewed drawing, {len(self.survivors)} by neither"
        )


def mutants() -> Iterator[Mutant]:
    """Every accepted cell removed, with each other target, with other methods; every refused cell accepted."""
    for state in State:
        for command in Command:
            cell = TABLE[state].get(command)
            if cell is None:
                for to in TARGETS:
                    yield Mutant(state, command, Transition((), to))
                    yield Mutant(state, command, Transition(_own_method(command), to))
                continue
            yield Mutant(state, command, None)
            for to in TARGETS:
                if to is not cell.to:
                    yield Mutant(state, command, cell._replace(to=to))
            for methods in _other_methods(cell.methods):
                yield Mutant(state, command, cell._replace(methods=methods))


def _own_method(command: Command) -> tuple[str, ...]:
    return (command.value,) if command.value in METHODS else ("stop", "finish")


def _other_methods(methods: tuple[str, ...]) -> list[tuple[str, ...]]:
    """None at all, one left out, one more, one replaced, another order."""
    found: set[tuple[str, ...]] = {()}
    for index in range(len(methods)):
        found.add(methods[:index] + methods[index + 1 :])
        found.update((*methods[:index], other, *methods[index + 1 :]) for other in METHODS)
    found.update((*methods, other) for other in METHODS)
    found.update((other, *methods) for other in METHODS)
    found.update(permutations(methods))
    return sorted(found - {methods})


@contextmanager
def in_force(mutant: Mutant) -> Iterator[None]:
    """Puts a mutant in the place of the table."""
    row: dict[Command, Transition] = dict(TABLE[mutant.state])
    if mutant.cell is None:
        del row[mutant.command]
    else:
        row[mutant.command] = mutant.cell
    table: Mapping[State, Mapping[Command, Transition]] = {**TABLE, mutant.state: row}
    lci.TABLE = table  # type: ignore[misc] # this is what a mutant is
    try:
        yield
    finally:
        lci.TABLE = TABLE  # type: ignore[misc]


def is_caught_by_scenarios(mutant: Mutant) -> bool:
    """Whether some scenario goes otherwise than a person expects; the mutated cell's own comes first."""
    own = (mutant.state.value, mutant.command.value)
    with in_force(mutant):
        return any(_is_wrong(*cell) for cell in (own, *table_scenarios.CELLS))


def _is_wrong(state: str, command: str) -> bool:
    try:
        return table_scenarios.run(state, command) != table_scenarios.expected(state, command)
    except (AssertionError, AttributeError, TypeError):  # the state was not reached, or a method fell over
        return True


def drawing() -> str:
    """The drawing in the documents."""
    found = re.search(r"```mermaid\n(.*?)```", DRAWING.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


def is_caught_by_drawing(mutant: Mutant) -> bool:
    """Whether the drawing of the mutant is another than the reviewed one."""
    with in_force(mutant):
        return lci.to_mermaid() != drawing()


def score() -> Score:
    """Runs all mutants."""
    everyone = list(mutants())
    by_scenarios = [is_caught_by_scenarios(mutant) for mutant in everyone]
    by_drawing = [is_caught_by_drawing(mutant) for mutant in everyone]
    survivors = [
        str(mutant) for mutant, *caught in zip(everyone, by_scenarios, by_drawing, strict=True) if not any(caught)
    ]
    return Score(len(everyone), sum(by_scenarios), sum(by_drawing), survivors)


if __name__ == "__main__":
    print(score())
