"""Checks a document against a msgspec type and reports all errors at once, each with its position."""

import re
import types
import typing
from enum import Enum
from typing import Any, Final, TypeVar

import msgspec

from gloc3.documents.yaml_nodes import YamlNode
from gloc3.errors import Finding, nearest

T = TypeVar("T")

_AT: Final = re.compile(r" - at `.*`$", re.DOTALL)
_KINDS: Final = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a mapping",
    "null": "nothing",
}
_SHOWN_MAX: Final = 40


def check(node: YamlNode, kind: type[T], file: str, findings: list[Finding], name: str = "") -> T | None:
    """Validates a node as `kind`; on errors returns None and appends a finding for each.

    Args:
        node: the parsed node.
        kind: a msgspec type.
        file: name of the input in findings.
        findings: where they are appended.
        name: name of the node in findings.
    """
    try:
        return msgspec.convert(node.value, kind)
    except msgspec.ValidationError:
        found = _Checker(file)
        found.visit(node, kind, name)
        findings.extend(found.findings)
    return None


def in_words(error: Exception) -> str:
    """A msgspec message, reworded for users who write YAML or fill in a form."""

    def words(match: re.Match[str]) -> str:
        return " or ".join(_KINDS.get(kind, kind) for kind in match[1].split(" | "))

    text = re.sub(r"`([^`]*)`", words, _AT.sub("", str(error)))
    return text[:1].lower() + text[1:]


def _strip(kind: Any) -> Any:
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    return kind


def _options(kind: Any) -> list[Any]:
    """The members of a union, or the type alone; None left out."""
    kind = _strip(kind)
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return [option for member in typing.get_args(kind) for option in _options(member) if option is not type(None)]
    return [kind]


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _words(kind: Any) -> list[str]:
    """The words that an enum, a Literal, or a union with them takes."""
    found: list[str] = []
    for option in _options(kind):
        if typing.get_origin(option) is typing.Literal:
            found += [str(word) for word in typing.get_args(option)]
        elif isinstance(option, type) and issubclass(option, Enum):
            found += [str(member.value) for member in option]
    return found


class _Checker:
    """Goes down a document and a type together."""

    def __init__(self, file: str) -> None:
        self._file = file
        self.findings: list[Finding] = []

    def visit(self, node: YamlNode, kind: Any, name: str) -> None:
        before = len(self.findings)
        options = _options(kind)
        if isinstance(node.value, dict):
            shapes = [o for o in options if _is_struct(o) or typing.get_origin(o) is dict]
            if len(shapes) == 1:
                self._mapping(node, shapes[0], name)
        elif isinstance(node.value, list):
            shapes = [o for o in options if typing.get_origin(o) in (list, tuple)]
            if len(shapes) == 1:
                self._sequence(node, shapes[0], name)
        if len(self.findings) == before:
            self._leaf(node, kind, name)

    def _mapping(self, node: YamlNode, shape: Any, name: str) -> None:
        if not _is_struct(shape):
            key_kind, value_kind = typing.get_args(shape)
            for key, child in node.children.items():
                self._key(node, str(key), key_kind)
                self.visit(child, value_kind, str(key))
            return
        fields = {field.encode_name: field for field in msgspec.structs.fields(shape)}
        forbids = shape.__struct_config__.forbid_unknown_fields
        for key, child in node.children.items():
            if key in fields:
                self.visit(child, fields[str(key)].type, str(key))
            elif forbids:
                hint = nearest(str(key), sorted(fields))
                self._add(child, f"unknown key {key!r}", hint, place=node.key_places[str(key)])
        for key, field in fields.items():
            if field.required and key not in node.children:
                owner = f" in {name}" if name else ""
                self._add(node, f"{key!r} is missing{owner}")

    def _key(self, node: YamlNode, key: str, kind: Any) -> None:
        try:
            msgspec.convert(key, kind)
        except msgspec.ValidationError as error:
            self._add(node.children[key], f"name {key!r}: {in_words(error)}", place=node.key_places[key])

    def _sequence(self, node: YamlNode, shape: Any, name: str) -> None:
        items = typing.get_args(shape)
        if not items:
            return
        is_fixed = typing.get_origin(shape) is tuple and items[-1] is not Ellipsis
        if is_fixed and len(items) != len(node.children):
            return
        for index, child in node.children.items():
            kind = items[int(index)] if is_fixed else items[0]
            self.visit(child, kind, f"{name}[{index}]")

    def _leaf(self, node: YamlNode, kind: Any, name: str) -> None:
        try:
            msgspec.convert(node.value, kind)
        except msgspec.ValidationError as error:
            message, hint = in_words(error), ""
            words = _words(kind)
            if isinstance(node.value, str) and words:
                message, hint = f"{node.value[:_SHOWN_MAX]!r} is not possible here", nearest(node.value, words)
            elif isinstance(node.value, str | int | float):
                message += f" ({str(node.value)[:_SHOWN_MAX]})"
                if isinstance(node.value, bool) and "text" in message:
                    hint = "put it in quotes"
            self._add(node, f"{name}: {message}" if name else message, hint)

    def _add(self, node: YamlNode, message: str, hint: str = "", place: tuple[int, int] | None = None) -> None:
        line, column = place or (node.line, node.column)
        if node.note:
            message = f"{message} ({node.note})"
        self.findings.append(
            Finding(file=node.file or self._file, line=line, column=column, message=message, hint=hint)
        )
