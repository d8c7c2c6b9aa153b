"""YAML files with the place of everything in them: limits, duplicate keys and bad numbers found, never a traceback.

Plain values are read by the core schema of YAML 1.2, plus `yes` and `no` as truth values; `1:30` and dates stay text.
Anchors, aliases, tags and several documents in one file are refused: they are of no use in a mission or platform file,
and with them a short file can stand for a huge one.
"""

import math
import re
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import yaml

from gloc3 import schema
from gloc3.errors import Finding, InputError

T = TypeVar("T")

Where = tuple[str | int, ...]
"""Keys and indexes from the root of a document to a value in it."""

MAX_BYTES: Final = 1_000_000
MAX_DEPTH: Final = 32
MAX_NODES: Final = 100_000
MAX_FINDINGS: Final = 50

_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_WORDS: Final = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE", "yes", "Yes", "YES"), True),
    **dict.fromkeys(("false", "False", "FALSE", "no", "No", "NO"), False),
}
_WHOLE: Final = re.compile(r"[-+]?[0-9]+|0x[0-9a-fA-F]+|0o[0-7]+")
_NUMBER: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE: Final = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_DIGITS_MAX: Final = 40
_WHOLE_MAX: Final = 2**63 - 1


class Node:
    """A value of a document with its place."""

    __slots__ = ("children", "column", "key_places", "line", "value")

    def __init__(self, value: Any, line: int, column: int) -> None:
        self.value: Any = value
        """Plain Python: None, bool, int, float, str, list or dict with text keys."""
        self.line = line
        self.column = column
        self.children: dict[str | int, Node] = {}
        """The nodes below, by key or index."""
        self.key_places: dict[str, tuple[int, int]] = {}
        """Line and column of each key of a mapping."""


class Document:
    """A file that was read: its plain value, and where each part of it stands."""

    def __init__(self, file: str, root: Node) -> None:
        self.file = file
        self.root = root

    @property
    def value(self) -> Any:
        """The whole as plain Python."""
        return self.root.value

    def node(self, where: Where) -> Node:
        """The node at a path, or the deepest one on the way to it that is there."""
        node = self.root
        for step in where:
            if step not in node.children:
                break
            node = node.children[step]
        return node

    def finding(
        self, where: Where, message: str, hint: str = "", *, at_key: bool = False, is_warning: bool = False
    ) -> Finding:
        """A finding about the value at a path, or about its key."""
        node = self.node(where)
        line, column = node.line, node.column
        if at_key and where:
            line, column = self.node(where[:-1]).key_places.get(str(where[-1]), (line, column))
        return Finding(file=self.file, line=line, column=column, message=message, hint=hint, is_warning=is_warning)


def load_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a file.

    Raises:
        InputError: it cannot be opened, or is larger than allowed; in that case it is not read at all.
    """
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise InputError([_too_large(str(path), size, max_bytes)])
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise InputError([Finding(file=str(path), message=f"cannot be read: {reason}")]) from error


def load(path: Path, kind: type[T]) -> T:
    """Reads a YAML file into a structure.

    Raises:
        InputError: with everything that is wrong in it.
    """
    return read(load_bytes(path), kind, str(path))


def read(data: bytes | str, kind: type[T], file: str) -> T:
    """Reads YAML into a structure.

    Args:
        data: the content; bytes are UTF-8.
        kind: a msgspec type; unknown keys are findings where it forbids them.
        file: what the findings call the input.

    Raises:
        InputError: with everything that is wrong, in order of place.
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
        line, column = _place(raw, error.start)
        raise InputError(
            [Finding(file=file, line=line, column=column, message="not UTF-8 text", hint="save the file as UTF-8")]
        ) from error
    builder = _Builder(file)
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            builder.take(event)
    except _TooMuch:
        pass
    except yaml.YAMLError as error:
        builder.findings.append(_yaml_finding(error, file, text))
    if builder.root is None and not builder.findings:
        builder.findings.append(Finding(file=file, message="the file is empty"))
    if builder.findings or builder.root is None:
        raise InputError(sorted(builder.findings))
    return Document(file, builder.root)


class _TooMuch(Exception):
    """Reading on is of no use; the reason is among the findings."""


class _Builder:
    """Makes nodes from YAML's events, without recursion."""

    def __init__(self, file: str) -> None:
        self.findings: list[Finding] = []
        self.root: Node | None = None
        self._file = file
        self._stack: list[Node] = []
        self._keys: list[str | None] = []
        self._nodes = 0
        self._documents = 0

    def take(self, event: yaml.Event) -> None:
        match event:
            case yaml.ScalarEvent():
                self._scalar(event)
            case yaml.MappingStartEvent():
                self._open(event, {})
            case yaml.SequenceStartEvent():
                self._open(event, [])
            case yaml.MappingEndEvent() | yaml.SequenceEndEvent():
                self._stack.pop()
                self._keys.pop()
            case yaml.AliasEvent():
                self._find(event, f"alias *{event.anchor} is not supported", "write the value out")
                self._put(event, None)
            case yaml.DocumentStartEvent():
                self._documents += 1
                if self._documents > 1:
                    self._find(event, "a second document begins here", "one file holds one document; remove the '---'")
                    raise _TooMuch

    def _scalar(self, event: yaml.ScalarEvent) -> None:
        self._refuse_extras(event)
        is_plain = event.style is None or event.style == ""
        if self._stack and isinstance(self._stack[-1].value, dict) and self._keys[-1] is None:
            self._key(event)
            return
        self._put(event, self._plain(event) if is_plain else event.value)

    def _open(self, event: yaml.CollectionStartEvent, value: dict[str, Any] | list[Any]) -> None:
        self._refuse_extras(event)
        if len(self._stack) >= MAX_DEPTH:
            self._find(event, f"nested more than {MAX_DEPTH} deep")
            raise _TooMuch
        if self._stack and isinstance(self._stack[-1].value, dict) and self._keys[-1] is None:
            self._find(event, "a key must be text, not a list or mapping")
            raise _TooMuch
        node = self._put(event, value)
        self._stack.append(node)
        self._keys.append(None)

    def _key(self, event: yaml.ScalarEvent) -> None:
        name: str = event.value
        places = self._stack[-1].key_places
        if name in places:
            self._find(event, f"{name!r} is given twice", f"first in line {places[name][0]}")
        else:
            places[name] = (event.start_mark.line + 1, event.start_mark.column + 1)
        self._keys[-1] = name

    def _put(self, event: yaml.Event, value: Any) -> Node:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            self._find(event, f"more than {MAX_NODES:,} values in one file")
            raise _TooMuch
        node = Node(value, event.start_mark.line + 1, event.start_mark.column + 1)
        if not self._stack:
            self.root = node
            return node
        parent = self._stack[-1]
        if isinstance(parent.value, dict):
            key = self._keys[-1]
            self._keys[-1] = None
            if key is not None and key not in parent.children:
                parent.value[key] = value
                parent.children[key] = node
        else:
            parent.children[len(parent.value)] = node
            parent.value.append(value)
        return node

    def _plain(self, event: yaml.ScalarEvent) -> Any:
        text: str = event.value
        if text in _WORDS:
            return _WORDS[text]
        if _WHOLE.fullmatch(text) or _NUMBER.fullmatch(text):
            if len(text) <= _DIGITS_MAX:
                value = _number(text)
                if math.isfinite(value) and abs(value) <= _WHOLE_MAX:
                    return value
            self._find(event, f"the number {text[:_DIGITS_MAX]} is out of range")
            return 0
        if _NOT_FINITE.fullmatch(text):
            self._find(event, f"{text} is not a finite number")
            return 0.0
        return text

    def _refuse_extras(self, event: yaml.NodeEvent) -> None:
        if event.anchor is not None:
            self._find(event, f"anchor &{event.anchor} is not supported", "write the value out where it is used")
        if getattr(event, "tag", None) is not None:
            self._find(event, f"tag {event.tag} is not supported", "leave the tag out")

    def _find(self, event: yaml.Event, message: str, hint: str = "") -> None:
        mark = event.start_mark
        self.findings.append(
            Finding(file=self._file, line=mark.line + 1, column=mark.column + 1, message=message, hint=hint)
        )
        if len(self.findings) >= MAX_FINDINGS:
            raise _TooMuch


def _number(text: str) -> int | float:
    if text.startswith(("0x", "0o")):
        return int(text, 0)
    return int(text) if _WHOLE.fullmatch(text) else float(text)


def _too_large(file: str, size: int, limit: int) -> Finding:
    return Finding(
        file=file,
        message=f"{size / 1e6:.1f} MB are too much: at most {limit / 1e6:g} MB are read",
        hint="is this the right file?",
    )


def _place(raw: bytes, offset: int) -> tuple[int, int]:
    start = raw.rfind(b"\n", 0, offset) + 1
    return raw.count(b"\n", 0, offset) + 1, len(raw[start:offset].decode("utf-8", "replace")) + 1


def _yaml_finding(error: yaml.YAMLError, file: str, text: str) -> Finding:
    """What YAML itself could not read, as a finding."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        line, column = error.problem_mark.line + 1, error.problem_mark.column + 1
        rows = text.splitlines()
        row = rows[line - 1] if line <= len(rows) else ""
        if "\t" in row[:column] and "cannot start" in str(error.problem):
            return Finding(
                file=file, line=line, column=column, message="a tab in the indentation", hint="YAML takes spaces only"
            )
        if error.context_mark is not None and error.context:
            began = f"{error.context} that begins in line {error.context_mark.line + 1}"
            return Finding(file=file, line=line, column=column, message=f"not YAML: {error.problem}", hint=began)
        return Finding(file=file, line=line, column=column, message=f"not YAML: {error.problem}")
    position = getattr(error, "position", None)
    if isinstance(position, int):
        raw = text.encode("utf-8", "surrogatepass")
        line, column = _place(raw, min(position, len(raw)))
        message = f"character {getattr(error, 'character', 0)!r} is not allowed"
        return Finding(file=file, line=line, column=column, message=message, hint="is this a text file?")
    return Finding(file=file, message=f"not YAML: {' '.join(str(error).split())}")
