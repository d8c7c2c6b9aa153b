"""Settings of components: typed, with units in the docs, bounds and defaults, checked when a component initializes."""

import ast
import inspect
import math
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import msgspec

from gloc3.errors import Finding, InputError, nearest


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The base of a component's settings; the string under a field is its documentation, with the unit."""


class NoSettings(Settings, frozen=True):
    """For components that have nothing to set."""


S = TypeVar("S", bound=Settings)


def Bounds(low: float, high: float) -> msgspec.Meta:  # noqa: N802 - reads as a type in an annotation
    """A closed range for a setting; of whole numbers for an `int`.

    Used as `min_m: Annotated[float, Bounds(0.0, 5.0)] = 0.2`.
    """
    return msgspec.Meta(ge=low, le=high)


def load_settings(settings_type: type[S], values: Mapping[str, Any], where: str) -> S:
    """Validates values against a settings type.

    Args:
        settings_type: the settings type.
        values: name to value, as read from a file or a message.
        where: name of the place in findings, such as the component's name.

    Raises:
        InputError: lists all errors; for an unknown name it suggests the nearest one.
    """
    fields = {field.encode_name: field for field in msgspec.structs.fields(settings_type)}
    wrong: list[tuple[str, str]] = []
    for name, value in values.items():
        if name not in fields:
            wrong.append((f"unknown setting {name!r}", nearest(str(name), sorted(fields))))
            continue
        wrong += [(f"{path} is not a finite number", "") for path in not_finite(value, name)]
        try:
            msgspec.convert(value, fields[name].type, strict=True)
        except msgspec.ValidationError as error:
            wrong.append((_in_words(name, error), ""))
    wrong += [(f"{name} is missing", "") for name, field in fields.items() if field.required and name not in values]
    if not wrong:
        try:
            return msgspec.convert(dict(values), settings_type, strict=True)
        except msgspec.ValidationError as error:
            wrong.append((_in_words("", error), ""))
    raise InputError([Finding(file=where, message=message, hint=hint) for message, hint in wrong])


def _in_words(name: str, error: msgspec.ValidationError) -> str:
    """What msgspec says, with the path of the value in front."""
    message, _, path = str(error).partition(" - at `$")
    place = name + path.rstrip("`")
    return f"{place.lstrip('.')}: {message}" if place else message


def not_finite(value: Any, path: str = "") -> Iterator[str]:
    """The paths of the numbers in nested values that are NaN or infinite."""
    if isinstance(value, float) and not math.isfinite(value):
        yield path
    elif isinstance(value, Mapping):
        for name, inner in value.items():
            yield from not_finite(inner, f"{path}.{name}" if path else str(name))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from not_finite(inner, f"{path}[{index}]")


def field_docs(struct: type[msgspec.Struct]) -> dict[str, str]:
    """Documentation strings under the fields of a structure and its bases, by field name."""
    docs: dict[str, str] = {}
    for base in reversed(struct.__mro__):
        if issubclass(base, msgspec.Struct) and base is not msgspec.Struct:
            docs |= _own_field_docs(base)
    return docs


def _own_field_docs(struct: type[msgspec.Struct]) -> Mapping[str, str]:
    return _docs_of_classes(struct.__module__).get(struct.__qualname__, {})


@cache
def _docs_of_classes(module: str) -> dict[str, dict[str, str]]:
    """Documentation strings under the fields of a module's classes, by the qualified name of each."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (KeyError, OSError, TypeError, SyntaxError):  # made at run time, or installed without its source
        return {}
    return {name: _docs_in(body) for name, body in _classes(tree.body, "")}


def _classes(statements: list[ast.stmt], place: str) -> Iterator[tuple[str, list[ast.stmt]]]:
    """The classes among some statements and in them, each with its qualified name and body."""
    for one in statements:
        if isinstance(one, ast.ClassDef):
            yield place + one.name, one.body
            yield from _classes(one.body, f"{place}{one.name}.")
        elif isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _classes(one.body, f"{place}{one.name}.<locals>.")


def _docs_in(body: list[ast.stmt]) -> dict[str, str]:
    docs: dict[str, str] = {}
    for field, below in pairwise(body):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
        ):
            docs[field.target.id] = inspect.cleandoc(str(below.value.value))
    return docs
