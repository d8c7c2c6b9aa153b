"""Values of any annotation that messages use, for property tests."""

import types
import typing
from enum import Enum
from typing import Any

import msgspec
from hypothesis import strategies as st

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
INTS = st.integers(-(2**63), 2**64 - 1)
PLAIN: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**31), 2**31) | st.floats(allow_nan=False) | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=4,
)
"""What JSON can hold."""


def values(annotation: Any) -> st.SearchStrategy[Any]:
    """Values of an annotation."""
    simple = {bool: st.booleans(), int: INTS, float: st.floats(), str: TEXTS, bytes: st.binary(max_size=16)}
    if annotation in simple:
        return simple[annotation]
    if annotation is Any:
        return PLAIN
    if annotation in (None, type(None)):
        return st.none()
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return values(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return st.one_of([values(argument) for argument in arguments])
    if origin is typing.Literal:
        return st.sampled_from(arguments)
    if origin is list:
        return st.lists(values(arguments[0]), max_size=3)
    if origin is dict:
        return st.dictionaries(values(arguments[0]), values(arguments[1]), max_size=3)
    if origin is tuple and arguments[-1] is Ellipsis:
        return st.lists(values(arguments[0]), max_size=3).map(tuple)
    if origin is tuple:
        return st.tuples(*(values(argument) for argument in arguments))
    if issubclass(annotation, Enum):
        return st.sampled_from(list(annotation))
    assert issubclass(annotation, msgspec.Struct), annotation
    return structures(annotation)


def structures(kind: type[msgspec.Struct]) -> st.SearchStrategy[Any]:
    """Structures of a type, with any of the fields that have defaults left out."""
    fields = msgspec.structs.fields(kind)
    return st.fixed_dictionaries(
        {field.name: values(field.type) for field in fields if field.required},
        optional={field.name: values(field.type) for field in fields if not field.required},
    ).map(lambda given: kind(**given))
