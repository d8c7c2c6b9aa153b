"""Which modules construct a class."""

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from tests.house.measure import read_modules

ROOT: Final = Path(__file__).parents[2]


class Calls(NamedTuple):
    """What a module calls by bare names."""

    imported: frozenset[tuple[str, str, str]]
    """Modules, names in them and the names that these have here."""
    called: frozenset[str]


@cache
def _calls() -> Mapping[str, Calls]:
    found = {}
    for name, module in read_modules(ROOT).items():
        imports = [node for node in module.nodes if isinstance(node, ast.ImportFrom)]
        called = (node.func for node in module.nodes if isinstance(node, ast.Call))
        found[name] = Calls(
            frozenset((node.module or "", one.name, one.asname or one.name) for node in imports for one in node.names),
            frozenset(one.id for one in called if isinstance(one, ast.Name)),
        )
    return found


def constructors_of(part: type) -> set[str]:
    """The modules of the source tree that call a class by its name."""
    wanted = part.__module__, part.__name__
    found = set()
    for module, calls in _calls().items():
        names = {own for source, name, own in calls.imported if (source, name) == wanted}
        own = {part.__name__} if module == part.__module__ else set()
        if calls.called & (names | own):
            found.add(module)
    return found
