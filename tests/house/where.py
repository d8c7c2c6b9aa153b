"""`docs/where-things-are.md`, made from the docstrings of the rooms and the first lines of their modules."""

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from tests.house.measure import Module, read_modules

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "where-things-are.md"
HEAD: Final = """\
# Where things are

Every package below is a room: about a dozen modules with one purpose. The modules in **bold** are its face: other rooms
import these and no others. This page is generated from the docstrings: `make docs` writes it, and a test compares it.
"""


def page(root: Path = ROOT) -> str:
    """The page for a tree."""
    return "\n".join([HEAD, *_rooms(read_modules(root))])


def face_of(package: Module) -> tuple[str, ...]:
    """The modules that a room names in `__all__`; empty where it names none."""
    for node in package.tree.body:
        if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["__all__"]:
            return tuple(ast.literal_eval(node.value))
    return ()


def _rooms(modules: Mapping[str, Module]) -> Iterator[str]:
    for name, module in modules.items():
        if not module.is_package:
            continue
        inside = [each for each in modules.values() if each.name.rpartition(".")[0] == name and not each.is_package]
        face = face_of(module)
        yield f"{'#' * min(name.count('.') + 2, 4)} `{name}`\n"
        yield f"{ast.get_docstring(module.tree) or ''}\n"
        if inside:
            yield "\n".join(_line(each, face) for each in inside) + "\n"


def _line(module: Module, face: tuple[str, ...]) -> str:
    name = module.name.rpartition(".")[2]
    first = (ast.get_docstring(module.tree) or "").partition("\n")[0]
    return f"- {f'**`{name}`**' if name in face else f'`{name}`'}: {first}"
