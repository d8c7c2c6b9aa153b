"""What the strings of a module may say, read from its source: alternatives apart, and the names of what is filled in."""

import ast
import re
from collections.abc import Iterator, Sequence
from enum import StrEnum
from importlib import import_module
from itertools import product
from typing import Any, Final

OPEN: Final = "…"
"""What is known only when it runs."""
MOST: Final = 8
"""Alternatives of one text that are told apart, and assignments that are followed."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


class ModuleTexts:
    """The texts of one module.

    Args:
        name: the module's.
        tree: its source.
    """

    def __init__(self, name: str, tree: ast.Module) -> None:
        self._name = name
        self._functions = {one.name: one for one in tree.body if isinstance(one, Function)}

    def of(self, node: ast.expr, function: Function) -> list[str]:
        """What an expression in a function may say."""
        return list(dict.fromkeys(self._said(node, function, 0)))

    def _said(self, node: ast.expr, function: Function, depth: int) -> Iterator[str]:
        match node:
            case ast.Constant(value=str(value)):
                yield value
            case ast.JoinedStr(values=values):
                yield from _joined([self._part(one, function, depth) for one in values])
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                yield from _joined([list(self._said(one, function, depth)) for one in (left, right)])
            case ast.IfExp(body=body, orelse=orelse):
                yield from self._said(body, function, depth)
                yield from self._said(orelse, function, depth)
            case ast.BoolOp(op=ast.Or(), values=values):
                for one in values:
                    yield from self._said(one, function, depth)
            case ast.Name(id=name) if depth < MOST and (given := assigned(name, function, node.lineno)):
                for one in given:
                    for text in self._said(one, function, depth + 1):
                        yield f"{{{name}}}" if text == OPEN else text
            case ast.Call(func=ast.Attribute(value=ast.Name() as template, attr="format")):
                yield re.sub(r"\{[^}]*\}", OPEN, str(self._constant(template)))
            case ast.Call(func=ast.Name(id=name)) if name in self._functions and depth < MOST:
                called = self._functions[name]
                returned = (one.value for one in ast.walk(called) if isinstance(one, ast.Return))
                for result in filter(None, returned):
                    yield from self._said(result, called, depth + 1)
            case ast.Name() | ast.Attribute():
                constant, name = self._constant(node), node.attr if isinstance(node, ast.Attribute) else node.id
                yield f"{{{name.strip('_')}}}" if constant is None else str(constant)
            case _:
                yield OPEN

    def _part(self, node: ast.expr, function: Function, depth: int) -> list[str]:
        """A piece of an f-string."""
        value = node.value if isinstance(node, ast.FormattedValue) else node
        constant = self._constant(value)
        return [f"{constant:g}"] if isinstance(constant, float) else list(self._said(value, function, depth))

    def _constant(self, node: ast.expr) -> Any:
        """A constant that the module defines or imports, or a member of such an enumeration; None for others."""
        match node:
            case ast.Name(id=name):
                found = vars(import_module(self._name)).get(name)
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if name[:1].isupper():
                found = getattr(vars(import_module(self._name)).get(name), attribute, None)
                found = str(found) if isinstance(found, StrEnum) else None
            case _:
                return None
        return found if isinstance(found, str | int | float) else None


def assigned(name: str, function: Function, line: int) -> list[ast.expr]:
    """What a local name may have been given before a line: the last assignment on each branch that leads there."""
    found: list[ast.expr] = []
    _collect(name, function.body, line, found)
    return found


def _collect(name: str, body: Sequence[ast.stmt], line: int, found: list[ast.expr]) -> bool:
    """Collects from a block, backwards; returns whether no earlier assignment reaches the line."""
    for statement in reversed(body):
        if statement.lineno > line:
            continue
        values = list(_given(name, statement))
        if values and (statement.end_lineno or line) < line:
            found += values
            return True
        inner = [getattr(statement, part, []) for part in ("body", "orelse", "finalbody")]
        inner += [handler.body for handler in getattr(statement, "handlers", [])]
        around = [block for block in inner if block and block[0].lineno <= line <= (block[-1].end_lineno or 0)]
        ended = [_collect(name, block, line, found) for block in around or inner if block]
        if (around and any(ended)) or (not around and len(ended) > 1 and all(ended)):
            return True
    return False


def _given(name: str, statement: ast.stmt) -> Iterator[ast.expr]:
    """What an assignment gives a name."""
    for target in statement.targets if isinstance(statement, ast.Assign) else ():
        if not isinstance(statement, ast.Assign):
            return
        if isinstance(target, ast.Name) and target.id == name:
            yield statement.value
        if isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
            pairs = zip(target.elts, statement.value.elts, strict=False)
            yield from (value for part, value in pairs if isinstance(part, ast.Name) and part.id == name)


def _joined(parts: list[list[str]]) -> Iterator[str]:
    count = 1
    for part in parts:
        count *= len(part)
    if count > MOST:
        parts = [part if len(part) == 1 else [OPEN] for part in parts]
    yield from ("".join(one) for one in product(*parts))
