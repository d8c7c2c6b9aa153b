"""Names in the code are words of the field, docstrings describe arguments that exist, and documents speak plainly."""

import ast
import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Final

from tests.evidence.__main__ import BARS
from tests.house import style
from tests.house.measure import read_modules, statements_of

ROOT: Final = Path(__file__).parents[2]
PRIVATE: Final = frozenset(
    [
        "ask",
        "caretaker",
        "confession",
        "errand",
        "errands",
        "hear",
        "hearsay",
        "herald",
        "jury",
        "keeper",
        "lament",
        "news",
        "say",
        "tell",
        "told",
        "watcher",
        "ways",
    ]
)
"""Words that are no names: `request`, `reply`, `report`, `receive`, `supervisor`, `queue`, `vote` and `route` are."""
SETTINGS: Final = frozenset({"is_climb_told", "is_range_told"})
"""Names that others have in their files."""
_WORD: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_ARGUMENTS: Final = re.compile(r"^Args:\n(.*?)(?=^\S|\Z)", re.MULTILINE | re.DOTALL)
_ENTRY: Final = re.compile(r"^    \*{0,2}(\w+)(?: \(.*\))?:", re.MULTILINE)

Function = ast.FunctionDef | ast.AsyncFunctionDef


def names_in(tree: ast.AST) -> Iterator[str]:
    """The names that a module's statements give to classes, functions, parameters, variables and attributes."""
    for statement in statements_of(tree):
        match statement:
            case ast.ClassDef():
                yield statement.name
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                yield statement.name
                yield from parameters_of(statement)
            case ast.Assign():
                yield from _given(*statement.targets)
            case ast.AnnAssign() | ast.AugAssign() | ast.For() | ast.AsyncFor():
                yield from _given(statement.target)
            case ast.With() | ast.AsyncWith():
                yield from _given(*(item.optional_vars for item in statement.items if item.optional_vars is not None))


def _given(*targets: ast.expr) -> Iterator[str]:
    for node in chain.from_iterable(map(ast.walk, targets)):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr


def private_names(name: str, tree: ast.AST) -> set[str]:
    """Names in a module with a word that is none of the field's."""
    found = {*names_in(tree), name.rpartition(".")[2]} - SETTINGS
    return {each for each in found if PRIVATE & {word.lower() for word in _WORD.findall(each)}}


def parameters_of(node: ast.AST) -> set[str]:
    """Parameters of a function, of a class's constructor, or the fields of a class without one."""
    if isinstance(node, ast.ClassDef):
        made = [each for each in node.body if isinstance(each, Function) and each.name in ("__init__", "__new__")]
        if made:
            return parameters_of(made[0])
        return {
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        }
    assert isinstance(node, Function)
    given = node.args
    return {
        each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg) if each
    }


def described(node: ast.AST) -> set[str]:
    """The arguments that a docstring describes."""
    text = ast.get_docstring(node) if isinstance(node, Function | ast.ClassDef) else None
    return set(chain.from_iterable(map(_ENTRY.findall, _ARGUMENTS.findall(text or ""))))


def test_names_are_words_of_the_field() -> None:
    found = {name: private_names(name, module.tree) for name, module in read_modules(ROOT).items()}
    assert {name: names for name, names in found.items() if names} == {}


def test_docstrings_describe_arguments_that_exist() -> None:
    found = [
        f"{module.path}:{node.lineno}: {', '.join(sorted(others))}"
        for module in read_modules(ROOT).values()
        for node in statements_of(module.tree)
        if isinstance(node, Function | ast.ClassDef) and (others := described(node) - parameters_of(node))
    ]
    assert found == []


def test_both_would_be_found() -> None:
    function = (
        'def f(tell):\n    """A.\n\n    Args:\n        tell: b.\n        *more: c (d).\n        e (f): g.\n    """\n'
    )
    tree = ast.parse(f"{function}a.told, b = 1, 2\n")
    assert private_names("m.herald", tree) == {"herald", "tell", "told"}
    assert described(tree.body[0]) - parameters_of(tree.body[0]) == {"more", "e"}


def test_documents_help_and_claims_speak_plainly() -> None:
    texts = [*style.texts(), *((f"evidence {bar.name}", f"{bar.title}. {bar.claim}") for bar in BARS)]
    assert len({where for where, _ in texts if where.endswith(".md")}) > 40
    assert len(texts) > 1100
    assert list(style.findings(texts)) == []


def test_a_riddle_would_be_found_and_code_is_none() -> None:
    assert style.riddles_in("It starts anew.\nWhat is wrong is told once.") == [
        "It starts anew",
        "What is wrong is told",
    ]
    assert style.riddles_in("Run `gloc3 anew`:\n```\nanew\n```\nagain, or tell your story") == []
