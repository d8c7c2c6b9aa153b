"""Measures of the source tree: files, lines, folders, names, import circles, constructors and parameters.

Everything is read as text with `ast`, so that trees of other commits can be measured, too.
"""

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

PACKAGES: Final = {
    "gloc3": "common",
    "gloc3_onboard": "onboard",
    "gloc3_groundstation": "groundstation",
    "gloc3_sitl": "sitl",
}
"""Import packages and the folders that hold them."""
MOST_PARAMETERS: Final = 7


class Module(NamedTuple):
    """A module of the source tree."""

    name: str
    path: Path
    tree: ast.Module
    nodes: Sequence[ast.AST]
    """All of the tree, at every depth: to walk through it takes far longer than to look through this."""
    lines: int
    is_package: bool


class Measures(NamedTuple):
    """Figures of one tree."""

    files: int
    lines: int
    statements: int
    """Those of Python, however they are laid out, docstrings aside."""
    test_files: int
    test_lines: int
    largest_folder: tuple[str, int]
    """Its path and its number of modules, `__init__` aside."""
    reused_class_names: tuple[str, ...]
    """Public classes whose name is defined in more than one module of the tree."""
    reused_in_a_package: tuple[str, ...]
    """`package: name` where a name is defined more than once within one of the four packages."""
    circles: tuple[tuple[str, ...], ...]
    """Modules that import each other, directly or not."""
    longest_constructor: tuple[str, int]
    """Its class and its number of lines, the docstring aside."""
    many_parameters: tuple[str, ...]
    """Functions with more than `MOST_PARAMETERS` parameters."""


@cache
def read_modules(root: Path) -> Mapping[str, Module]:
    """All modules of the four packages below a root, by their dotted names; they are read once."""
    found = {}
    for package, folder in PACKAGES.items():
        for path in sorted((root / folder / package).rglob("*.py")):
            parts = path.relative_to(root / folder).with_suffix("").parts
            is_package = parts[-1] == "__init__"
            name = ".".join(parts[:-1] if is_package else parts)
            text = path.read_text(encoding="utf-8")
            tree = ast.parse(text)
            place, nodes = path.relative_to(root), list(ast.walk(tree))
            found[name] = Module(name, place, tree, nodes, text.count("\n"), is_package)
    return found


def room_names(root: Path) -> list[str]:
    """The dotted names of all packages below a root."""
    return sorted(
        ".".join(path.parent.relative_to(root / folder).parts)
        for package, folder in PACKAGES.items()
        for path in (root / folder / package).rglob("__init__.py")
    )


def imports_of(module: Module, known: Iterable[str]) -> Iterator[str]:
    """The modules of the tree that a module imports anywhere in its text, for type checkers only included."""
    names = set(known)
    for node in module.nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner in names:
                    yield inner
                elif node.module in names:
                    yield node.module


def find_circles(arrows: dict[str, set[str]]) -> list[tuple[str, ...]]:
    """The strongly connected components of more than one module (Tarjan 1972), without recursion."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    circles = []
    for start in sorted(arrows):
        if start in index:
            continue
        work = [(start, iter(sorted(arrows[start])))]
        index[start] = low[start] = len(index)
        stack.append(start)
        while work:
            name, rest = work[-1]
            for other in rest:
                if other not in index:
                    index[other] = low[other] = len(index)
                    stack.append(other)
                    work.append((other, iter(sorted(arrows.get(other, ())))))
                    break
                if other in stack:
                    low[name] = min(low[name], index[other])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[name])
                if low[name] == index[name]:
                    at = stack.index(name)
                    circle, stack = stack[at:], stack[:at]
                    if len(circle) > 1:
                        circles.append(tuple(sorted(circle)))
    return circles


def measure(root: Path) -> Measures:
    """Measures the tree below a root."""
    modules = read_modules(root)
    folders: dict[str, int] = defaultdict(int)
    classes: dict[str, list[str]] = defaultdict(list)
    longest, many = ("", 0), []
    for module in modules.values():
        folders[str(module.path.parent)] += not module.is_package
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes[node.name].append(module.name)
        for where, function in functions_of(module.tree, module.name):
            if _parameters(function) > MOST_PARAMETERS:
                many.append(where)
            if function.name == "__init__" and _length(function) > longest[1]:
                longest = (where, _length(function))
    arrows = {name: set(imports_of(module, modules)) - {name} for name, module in modules.items()}
    tests = list((root / "tests").rglob("*.py"))
    return Measures(
        files=len(modules),
        lines=sum(module.lines for module in modules.values()),
        statements=sum(_is_code(each) for module in modules.values() for each in statements_of(module.tree)),
        test_files=len(tests),
        test_lines=sum(path.read_text(encoding="utf-8").count("\n") for path in tests),
        largest_folder=max(folders.items(), key=lambda item: item[1]),
        reused_class_names=tuple(sorted(name for name, where in classes.items() if len(where) > 1)),
        reused_in_a_package=tuple(sorted(_reused_in_packages(classes))),
        circles=tuple(find_circles(arrows)),
        longest_constructor=longest,
        many_parameters=tuple(sorted(many)),
    )


def _reused_in_packages(classes: dict[str, list[str]]) -> Iterator[str]:
    for name, where in classes.items():
        tops = [module.partition(".")[0] for module in where]
        yield from (f"{top}: {name}" for top in set(tops) if tops.count(top) > 1)


def functions_of(tree: ast.AST, where: str) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{where}.{node.name}", node
            yield from functions_of(node, f"{where}.{node.name}")
        elif isinstance(node, ast.ClassDef):
            yield from functions_of(node, f"{where}.{node.name}")
        else:
            yield from functions_of(node, where)


def statements_of(tree: ast.AST) -> Iterator[ast.stmt]:
    """All statements in a module or in another statement, at every depth."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for node in getattr(tree, part, ()):
            if isinstance(node, ast.stmt):
                yield node
            yield from statements_of(node)


def _is_code(statement: ast.stmt) -> bool:
    """Whether a statement does more than document."""
    return not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant))


def _parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def _length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of the body, a docstring aside."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
