"""The page of messages and remedies: what a check or a finding says, and what to do, as the source says it."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from tests.house.measure import read_modules

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "troubleshooting.md"
OPEN: Final = "…"
"""What differs from case to case."""
CHAPTERS: Final = (
    ("gloc3_onboard.checks", "Before the start: the pre-flight list and `gloc3 doctor`"),
    ("gloc3.mission", "Missions and plans"),
    ("gloc3.platform", "Platform files"),
    ("gloc3.component", "Components"),
    ("gloc3.network", "The network"),
    ("gloc3.mavlink", "MAVLink links and keys"),
    ("gloc3_onboard", "Sensors and the onboard process"),
    ("gloc3_groundstation", "The ground station"),
    ("gloc3_sitl", "Simulation"),
    ("gloc3", "Logs and all else"),
)
"""Beginnings of modules, the longer ones first, with their titles."""
FINDINGS: Final = ("finding", "_add", "_find", "_finding", "_at", "_warn")
"""Functions whose last two arguments are a message and a hint."""
HEAD: Final = """# Troubleshooting: it says this, do that

Every check and every finding of GLOC3 that knows a remedy says it itself, after an arrow or in brackets. This page lists
them for a search, as they stand in the source; `…` stands for names and numbers. `make docs` makes it.

A vehicle that did what you did not expect: `gloc3 log why RUN EVENT` names the causes, back to the root
([proof](proof.md#why-and-what-if)). A component that is faulty: the screen *Health* shows its last error, and
`gloc3 log info RUN --events` all of them.
"""


class Remedy(NamedTuple):
    """A row of the page."""

    says: str
    do: str


def page() -> str:
    """The whole page."""
    found: dict[str, set[Remedy]] = {title: set() for _, title in CHAPTERS}
    for name, module in read_modules(ROOT).items():
        title = next((title for begin, title in CHAPTERS if f"{name}.".startswith(f"{begin}.")), None)
        if title is not None:
            found[title].update(remedies(module.nodes))
    lines = [HEAD]
    for title, rows in found.items():
        if rows:
            lines += [f"## {title}\n", "| it says | do |", "| --- | --- |"]
            lines += [f"| {_cell(row.says)} | {_cell(row.do)} |" for row in sorted(rows)]
            lines.append("")
    return "\n".join(lines).rstrip("\n") + "\n"


def remedies(nodes: Iterable[ast.AST]) -> Iterator[Remedy]:
    """The checks and findings that know a remedy.

    Args:
        nodes: of a module, all of them.
    """
    for function in nodes:
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            inside = list(ast.walk(function))
            calls = [(one, parts) for one in inside if isinstance(one, ast.Call) and (parts := _parts(one)) is not None]
            assigned = _assigned(inside) if calls else {}
            for call, (title, message, hint) in calls:
                for says, do in _pairs(_texts(message, assigned, call.lineno), _texts(hint, assigned, call.lineno)):
                    yield from _row(f"{said(title)}: {says}" if title is not None else says, do)


def _parts(call: ast.Call) -> tuple[ast.expr | None, ast.expr, ast.expr] | None:
    """Title, message and hint of a call that makes a check or a finding."""
    named, name = {one.arg: one.value for one in call.keywords}, _name(call.func)
    if name == "Check" and len(call.args) == 5:
        return call.args[1], call.args[3], call.args[4]
    if name in FINDINGS and len(call.args) >= 3:
        return None, call.args[-2], call.args[-1]
    if "hint" in named and (message := named.get("message") or next(reversed(call.args), None)) is not None:
        return None, message, named["hint"]
    return None


def _name(function: ast.expr) -> str:
    return (
        function.attr if isinstance(function, ast.Attribute) else function.id if isinstance(function, ast.Name) else ""
    )


def _row(says: str, do: str) -> Iterator[Remedy]:
    if says.replace(OPEN, "").strip(" :,") and do.replace(OPEN, "").strip(" :,"):
        yield Remedy(says, do)


def _pairs(says: list[str], do: list[str]) -> Iterator[tuple[str, str]]:
    """Those that were given together; where that is not seen, the last ones."""
    yield from zip(says, do, strict=True) if len(says) == len(do) else ((says[-1], do[-1]),)


def _assigned(nodes: Iterable[ast.AST]) -> dict[str, list[tuple[int, str]]]:
    """What local names are given, with the lines."""
    found: dict[str, list[tuple[int, str]]] = {}
    for one in nodes:
        targets = one.targets if isinstance(one, ast.Assign) else []
        for target in targets:
            if isinstance(target, ast.Name) and isinstance(one, ast.Assign):
                found.setdefault(target.id, []).append((one.lineno, said(one.value)))
    return {name: sorted(given) for name, given in found.items()}


def _texts(node: ast.expr, assigned: dict[str, list[tuple[int, str]]], line: int) -> list[str]:
    """What an expression may say in a line."""
    if not isinstance(node, ast.Name):
        return [said(node)]
    return [text for at, text in assigned.get(node.id, []) if at <= line] or [OPEN]


def said(node: ast.expr) -> str:
    """What an expression says; `…` for what is known only when it runs."""
    match node:
        case ast.Constant(value=str(value)):
            return value
        case ast.JoinedStr(values=values):
            return "".join(said(one) if isinstance(one, ast.Constant) else OPEN for one in values)
        case ast.BinOp(left=left, right=right):
            return said(left) + said(right)
        case ast.IfExp(body=body):
            return said(body) or OPEN
    return OPEN


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")
