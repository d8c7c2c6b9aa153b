"""YAML files with source positions: reports broken limits, duplicate keys and bad numbers, never a traceback.

Plain values are read by the core schema of YAML 1.2, plus `yes` and `no` as truth values; `1:30` and dates stay text.
Anchors, aliases, tags and several documents in one file are refused: mission and platform files do not need them, and
with them a short file can expand to a huge one.
"""

from collections.abc import Mapping
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import yaml

from gloc3.amounts import beside
from gloc3.documents import schema
from gloc3.documents.yaml_nodes import YamlNode, build, place_of, stays_text
from gloc3.errors import Finding, InputError, NotFound

T = TypeVar("T")

Where = tuple[str | int, ...]
"""Keys and indexes from the root of a document to a value in it."""

MAX_BYTES: Final = 1_000_000
WIDTH: Final = 120


class Document:
    """A parsed file: its plain value, and the position of each part."""

    def __init__(self, file: str, root: YamlNode, bases: tuple[Path, ...] = ()) -> None:
        self.file = file
        self.root = root
        self.bases = bases
        """Files that it extends, the nearest first."""

    @property
    def value(self) -> Any:
        """The whole as plain Python."""
        return self.root.value

    def node(self, where: Where) -> YamlNode:
        """The node at a path, or its deepest existing ancestor."""
        node = self.root
        for step in where:
            if step not in node.children:
                break
            node = node.children[step]
        return node

    def seen_as(self, key: str, other: str) -> "Document":
        """The same document, with the value of the key `other` at `key`."""
        root = YamlNode(self.root.value, self.root.line, self.root.column, self.root.file)
        root.children, root.key_places = dict(self.root.children), dict(self.root.key_places)
        root.children.pop(key, None)
        if other in self.root.children:
            root.children[key], root.key_places[key] = root.children[other], root.key_places[other]
        return Document(self.file, root, self.bases)

    def finding(
        self, where: Where, message: str, hint: str = "", *, at_key: bool = False, is_warning: bool = False
    ) -> Finding:
        """A finding about the value at a path, or about its key."""
        node = self.node(where)
        line, column = node.line, node.column
        if at_key and where:
            line, column = self.node(where[:-1]).key_places.get(str(where[-1]), (line, column))
        if node.note:
            message = f"{message} ({node.note})"
        return Finding(
            file=node.file or self.file, line=line, column=column, message=message, hint=hint, is_warning=is_warning
        )


def load_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a file.

    Raises:
        NotFound: it cannot be opened.
        InputError: it is larger than allowed; in that case it is not read at all, or, if its size is not known before (a pipe, a device), no further than that.
    """
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise InputError([_too_large(str(path), size, max_bytes)])
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
        if len(data) > max_bytes:
            raise InputError([_too_large(str(path), len(data), max_bytes)])
        return data
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise NotFound([Finding(file=str(path), message=f"cannot be read: {reason}")]) from error


def load(path: Path, kind: type[T]) -> T:
    """Reads a YAML file into a structure.

    Raises:
        InputError: with everything that is wrong in it.
    """
    return read(load_bytes(path), kind, str(path))


def read(data: bytes | str, kind: type[T], file: str) -> T:
    """Parses YAML into a structure.

    Args:
        data: the content; bytes are UTF-8.
        kind: a msgspec type; unknown keys are findings where it forbids them.
        file: name of the input in findings.

    Raises:
        InputError: lists all errors, in order of position.
    """
    document = parse(data, file)
    findings: list[Finding] = []
    value = schema.check(document.root, kind, file, findings)
    if findings:
        raise InputError(sorted(findings))
    return cast("T", value)


def parse(data: bytes | str, file: str) -> Document:
    """Reads YAML with the place of everything in it.

    Raises:
        InputError: with everything that is wrong, up to the first mistake of YAML itself.
    """
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    if len(raw) > MAX_BYTES:
        raise InputError([_too_large(file, len(raw), MAX_BYTES)])
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = place_of(raw, error.start)
        raise InputError(
            [Finding(file=file, line=line, column=column, message="not UTF-8 text", hint="save the file as UTF-8")]
        ) from error
    root, findings = build(text, file)
    if root is None and not findings:
        findings.append(Finding(file=file, message="the file is empty"))
    if findings or root is None:
        raise InputError(sorted(findings))
    return Document(file, root)


class _Dumper(yaml.SafeDumper):
    """YAML dumper that quotes text where our own reader would not read it as text, and never writes an alias."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> Any:
        del indentless
        return super().increase_indent(flow, False)

    def choose_scalar_style(self) -> str:
        style: str = super().choose_scalar_style()
        return '"' if style == "'" else style


def _text(dumper: _Dumper, text: str) -> yaml.Node:
    style = None if stays_text(text) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def dump(value: Any) -> str:
    """Plain Python as YAML: the innermost lists and mappings in one line, the rest one entry a line."""
    return yaml.dump(value, Dumper=_Dumper, default_flow_style=None, sort_keys=False, width=WIDTH, allow_unicode=True)


def dump_rows(value: Mapping[str, Any]) -> str:
    """A mapping as YAML of two levels: each entry of its mappings, and of its lists of mappings, is one line."""
    lines = []
    for key, part in value.items():
        if isinstance(part, dict) and (
            len(line := f"{key}: {_in_line(part)}") > WIDTH or "{" in line.partition("{")[2]
        ):
            lines += [f"{key}:", *(f"  {name}: {_in_line(entry)}" for name, entry in part.items())]
        elif isinstance(part, list) and any(isinstance(entry, dict) for entry in part):
            lines += [f"{key}:", *(f"  - {_in_line(entry)}" for entry in part)]
        else:
            lines.append(f"{key}: {_in_line(part)}")
    return "\n".join(lines) + "\n"


def _in_line(value: Any) -> str:
    match value:
        case dict():
            return "{" + ", ".join(f"{_in_line(key)}: {_in_line(part)}" for key, part in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_in_line, value)) + "]"
        case _:
            return _scalar(value, repr(value))


@lru_cache(4096)
def _scalar(value: str | float | bool | None, _exactly: str) -> str:
    """A single value, as it stands in one line with others; its `repr` tells equal ones apart, as 1, True and 1.0."""
    text: str = yaml.dump(
        [value], Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=inf, allow_unicode=True
    )
    return text.strip()[1:-1]


def _too_large(file: str, size: int, limit: int) -> Finding:
    return Finding(
        file=file,
        message=f"{beside(size / 1e6, limit / 1e6)} MB is too large: the limit is {limit / 1e6:g} MB",
        hint="is this the right file?",
    )
