"""Settings of components: typed, with units in the docs, bounds and defaults, checked when a component initializes."""

import ast
import inspect
import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import msgspec

from gloc3.errors import Finding, InputError, nearest


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The base of a component's settings; the string under a field is its documentation, with the unit."""


class NoSettings(Settings, frozen=True):
    """For components that have nothing to set."""


S = TypeVar("S", bound=Settings)


def Bounds(low: float, high: float) -> msgspec.Meta:  # noqa: N802 - reads as a type in an annotation
    """A closed range for a setting: `min_m: Annotated[float, Bounds(0.0, 5.0)]`."""
    return msgspec.Meta(ge=low, le=high)


def load_settings(settings_type: type[S], values: Mapping[str, Any], where: str) -> S:
    """Checks values against a settings type.

    Args:
        settings_type: what they must fit.
        values: name to value, as read from a file or a message.
        where: what the findings call the place, such as the component's name.

    Raises:
        InputError: with everything that is wrong; an unknown name comes with the nearest one.
    """
    known = {field.encode_name for field in msgspec.structs.fields(settings_type)}
    findings = [
        Finding(file=where, message=f"unknown setting {name!r}", hint=nearest(name, sorted(known)))
        for name in values
        if name not in known
    ]
    findings += [Finding(file=where, message=f"{path} is not a finite number") for path in not_finite(values)]
    result: S | None = None
    try:
        result = msgspec.convert({k: v for k, v in values.items() if k in known}, settings_type, strict=True)
    except msgspec.ValidationError as error:
        findings.append(Finding(file=where, message=str(error)))
    if findings or result is None:
        raise InputError(findings)
    return result


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
    """The documentation strings that stand under a structure's own fields, by field name."""
    body = ast.parse(textwrap.dedent(inspect.getsource(struct))).body[0]
    if not isinstance(body, ast.ClassDef):
        return {}
    docs: dict[str, str] = {}
    for field, below in zip(body.body, body.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
        ):
            docs[field.target.id] = inspect.cleandoc(str(below.value.value))
    return docs
