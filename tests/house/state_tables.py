"""`docs/reference/states.md`: the tables of states of components and of missions, policies and severities."""

import ast
import inspect
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from itertools import pairwise
from typing import Any, Final

from tests.house.table import plain, table

from gloc3.component import lci
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import Cause, Health
from gloc3.mission.model import states
from gloc3.mission.model.policy import Policy

ERROR: Final = "an error"


def lines() -> Iterator[str]:
    """The page."""
    yield "A row names a state and a command; a command without an entry is refused. [states.md](../states.md) explains them.\n"
    yield "## Components\n"
    commands = {
        state: {one: str(row.to or "absent") for one, row in found.items()} for state, found in lci.TABLE.items()
    }
    yield from _matrix(lci.State, lci.Command, commands)
    yield f"{ERROR.capitalize()} in a method or a cycle leads from every state to `faulty`.\n"
    yield "## Missions, tasks and actions\n"
    yield from _matrix(states.ActionState, states.StateTrigger, states.TABLE)
    ours = ", ".join(f"`{one}`" for one in states.OURS)
    yield f"The onboard process itself triggers {ours}; operators and policies trigger the others.\n"
    for title, kind in (
        ("States of components", lci.State),
        ("States of components as stations see them", Health),
        ("States of missions, tasks and actions", states.ActionState),
        ("Policies", Policy),
        ("Causes of alerts and events", Cause),
        ("Severities", Severity),
    ):
        yield f"## {title}\n"
        yield f"{plain(kind.__doc__ or '')}\n"
        docs = _docs(kind)
        rows = ((_word(one), docs.get(one.name, "")) for one in kind)
        yield from table(("value", "meaning"), rows)


def _matrix(rows: Iterable[Any], columns: Iterable[Any], found: Mapping[Any, Mapping[Any, Any]]) -> Iterator[str]:
    """A row for each state, a column for each command, and the next state in the cell."""
    heads = list(columns)
    cells = ((f"`{row}`", *(str(found[row].get(one, "")) for one in heads)) for row in rows)
    yield from table(("state", *(f"{one}" for one in heads)), cells)


def _word(one: Enum) -> str:
    return f"`{one.name.lower()}` ({one.value})" if isinstance(one.value, int) else f"`{one.value}`"


def _docs(kind: type[Enum]) -> dict[str, str]:
    """The texts under the members of an enumeration."""
    (definition,) = ast.parse(inspect.getsource(kind)).body
    body = definition.body if isinstance(definition, ast.ClassDef) else []
    return {
        member.targets[0].id: str(text.value.value)
        for member, text in pairwise(body)
        if isinstance(member, ast.Assign) and isinstance(member.targets[0], ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }
