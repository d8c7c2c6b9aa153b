"""Branches of the executor that a flight takes: they tell the search which flights do something that none before did.

The functions of the executor's modules are compiled once more with a note at the beginning of each branch, and get that
code for the time of a flight. A note is one call at a branch that is taken, so that a flight costs as much as without.
"""

import ast
import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from inspect import getsource
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final

PACKAGES: Final = ("gloc3.mission.executing",)
"""All modules of these are observed."""
MODULES: Final = ("gloc3_onboard.command_server.mission_host", "gloc3_onboard.command_server.start_gate")
NOTE: Final = "__branch_taken__"
_Code = tuple[FunctionType, CodeType, CodeType]
"""A function, its own code, and that with the notes."""


@contextmanager
def taken_branches() -> Iterator[set[str]]:
    """Gives a set that is filled with the branches that are taken meanwhile, as `MODULE:LINE`."""
    taken: set[str] = set()
    modules, functions = _instrumented()
    for module in modules:
        setattr(module, NOTE, taken.add)
    for function, _, noting in functions:
        function.__code__ = noting
    try:
        yield taken
    finally:
        for function, own, _ in functions:
            function.__code__ = own
        for module in modules:
            delattr(module, NOTE)


@cache
def _instrumented() -> tuple[list[ModuleType], list[_Code]]:
    """The observed modules, and their functions with both codes."""
    modules = [importlib.import_module(name) for name in _names()]
    return modules, [one for module in modules for one in instrument(module)]


def _names() -> Iterator[str]:
    for package in PACKAGES:
        path = importlib.import_module(package).__path__
        yield from (f"{package}.{found.name}" for found in pkgutil.iter_modules(path))
    yield from MODULES


def instrument(module: ModuleType) -> Iterator[_Code]:
    """Compiles a module's functions with notes; none of them is changed yet."""
    tree = _Notes(module.__name__.rpartition(".")[2]).visit(ast.parse(getsource(module)))
    whole = compile(ast.fix_missing_locations(tree), module.__file__ or module.__name__, "exec")
    codes = {(code.co_qualname, code.co_firstlineno): code for code in _nested(whole)}
    for function in _functions(module):
        own = function.__code__
        noting = codes.get((own.co_qualname, own.co_firstlineno))
        if noting is not None and noting.co_freevars == own.co_freevars:
            yield function, own, noting


def _nested(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _nested(constant)


def _functions(module: ModuleType) -> Iterator[FunctionType]:
    """The functions and methods that a module defines; those inside them come with their code."""
    for value in vars(module).values():
        if getattr(value, "__module__", None) != module.__name__:
            continue
        for found in vars(value).values() if isinstance(value, type) else (value,):
            for function in _unwrapped(found):
                if function.__module__ == module.__name__:
                    yield function


def _unwrapped(found: Any) -> Iterator[FunctionType]:
    if isinstance(found, FunctionType):
        yield found
    elif isinstance(found, classmethod | staticmethod):
        yield from _unwrapped(found.__func__)
    elif isinstance(found, property):
        for function in (found.fget, found.fset):
            yield from _unwrapped(function)


class _Notes(ast.NodeTransformer):
    """Puts a note at the beginning of each branch of a module."""

    def __init__(self, name: str) -> None:
        self._name = name

    def _noted(self, body: list[ast.stmt], line: int, word: str = "") -> list[ast.stmt]:
        """A block that begins with its note."""
        call = ast.Call(ast.Name(NOTE, ast.Load()), [ast.Constant(f"{self._name}:{line}{word}")], [])
        return [ast.Expr(call), *body]

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Both ways of an `if`, where the other one is not written, too; and the bodies of all else that branches."""
        super().generic_visit(node)
        match node:
            case ast.If(body=body, orelse=other, lineno=line):
                is_chain = len(other) == 1 and isinstance(other[0], ast.If)
                node.body = self._noted(body, line)
                node.orelse = other if is_chain else self._noted(other, line, " not")
            case ast.match_case(pattern=pattern, body=body):
                node.body = self._noted(body, pattern.lineno)
            case ast.For(body=body, lineno=line) | ast.While(body=body, lineno=line):
                node.body = self._noted(body, line)
            case ast.ExceptHandler(body=body, lineno=line):
                node.body = self._noted(body, line)
            case _:
                pass
        return node
