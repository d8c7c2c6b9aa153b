"""Builds nodes (values with source positions) from a YAML parser's events, without recursion and within limits."""

import math
import re
from collections.abc import Iterator
from typing import Any, Final

import yaml

from gloc3.errors import Finding

MAX_DEPTH: Final = 32
MAX_NODES: Final = 50_000
MAX_FINDINGS: Final = 50

LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_WORDS: Final = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE", "yes", "Yes", "YES"), True),
    **dict.fromkeys(("false", "False", "FALSE", "no", "No", "NO"), False),
}
_WHOLE: Final = re.compile(r"[-+]?[0-9]+|0x[0-9a-fA-F]+|0o[0-7]+")
_NUMBER: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE: Final = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_NUMBERS_BEGIN: Final = frozenset("+-.0123456789")
_DIGITS_MAX: Final = 40
_WHOLE_MAX: Final = 2**63 - 1


class YamlNode:
    """A value of a document with its place."""

    __slots__ = ("children", "column", "file", "key_places", "line", "note", "value")

    def __init__(self, value: Any, line: int, column: int, file: str = "", note: str = "") -> None:
        self.value: Any = value
        """Plain Python: None, bool, int, float, str, list or dict with text keys."""
        self.line = line
        self.column = column
        self.file = file
        """File that it is in, if not the document's own."""
        self.note = note
        """Additional text for findings about this node, such as what it was inserted for."""
        self.children: dict[str | int, YamlNode] = {}
        """The nodes below, by key or index."""
        self.key_places: dict[str, tuple[int, int]] = {}
        """Line and column of each key of a mapping."""

    def put(self, key: str | int, child: "YamlNode", place: tuple[int, int] | None = None) -> None:
        """Sets a value of a mapping, with the place of its key, or the next of a list."""
        self.children[key] = child
        if isinstance(self.value, dict):
            self.value[key] = child.value
            if place is not None:
                self.key_places[str(key)] = place
        else:
            self.value.append(child.value)

    def descendants(self) -> Iterator["YamlNode"]:
        """The node itself, and all below it."""
        waiting = [self]
        while waiting:
            one = waiting.pop()
            yield one
            waiting += one.children.values()


def build(text: str, file: str) -> tuple[YamlNode | None, list[Finding]]:
    """The root of a YAML document (None if there is none), and everything that is wrong with it."""
    builder = _Builder(file)
    try:
        for event in yaml.parse(text, Loader=LOADER):
            builder.add_event(event)
    except _TooMuch:
        pass
    except yaml.YAMLError as error:
        builder.findings.append(_yaml_finding(error, file, text))
    return builder.root, builder.findings


class _TooMuch(Exception):
    """Stops the reading because going on is useless; the reason is among the findings."""


class _Builder:
    """Makes nodes from YAML's events, without recursion."""

    def __init__(self, file: str) -> None:
        self.findings: list[Finding] = []
        self.root: YamlNode | None = None
        self._file = file
        self._stack: list[YamlNode] = []
        self._keys: list[str | None] = []
        self._nodes = 0
        self._documents = 0

    def add_event(self, event: yaml.Event) -> None:
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
                    self._find(event, "a second document starts here", "one file holds one document; remove the '---'")
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
            places[name] = _mark(event)
        self._keys[-1] = name

    def _put(self, event: yaml.Event, value: Any) -> YamlNode:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            self._find(event, f"more than {MAX_NODES:,} values in one file")
            raise _TooMuch
        node = YamlNode(value, *_mark(event))
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
        if text[0] not in _NUMBERS_BEGIN:
            return text
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

    def _refuse_extras(self, event: yaml.ScalarEvent | yaml.CollectionStartEvent) -> None:
        if event.anchor is not None:
            self._find(event, f"anchor &{event.anchor} is not supported", "write the value out where it is used")
        if event.tag is not None:
            self._find(event, f"tag {event.tag} is not supported", "leave the tag out")

    def _find(self, event: yaml.Event, message: str, hint: str = "") -> None:
        line, column = _mark(event)
        self.findings.append(Finding(file=self._file, line=line, column=column, message=message, hint=hint))
        if len(self.findings) >= MAX_FINDINGS:
            raise _TooMuch


def stays_text(text: str) -> bool:
    """Whether a plain scalar is read back as text."""
    return not (text in _WORDS or _WHOLE.fullmatch(text) or _NUMBER.fullmatch(text) or _NOT_FINITE.fullmatch(text))


def _number(text: str) -> int | float:
    if text.startswith(("0x", "0o")):
        return int(text, 0)
    return int(text) if _WHOLE.fullmatch(text) else float(text)


def _mark(event: yaml.Event) -> tuple[int, int]:
    mark = event.start_mark
    return (mark.line + 1, mark.column + 1) if mark is not None else (0, 0)


def place_of(raw: bytes, offset: int) -> tuple[int, int]:
    """Line and column, from 1, of a byte of UTF-8 text."""
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
                file=file, line=line, column=column, message="a tab in the indentation", hint="YAML allows spaces only"
            )
        if error.context_mark is not None and error.context:
            began = f"{error.context} that starts in line {error.context_mark.line + 1}"
            return Finding(file=file, line=line, column=column, message=f"not YAML: {error.problem}", hint=began)
        return Finding(file=file, line=line, column=column, message=f"not YAML: {error.problem}")
    position = getattr(error, "position", None)
    if isinstance(position, int):
        raw = text.encode("utf-8", "surrogatepass")
        line, column = place_of(raw, min(position, len(raw)))
        message = f"character {getattr(error, 'character', 0)!r} is not allowed"
        return Finding(file=file, line=line, column=column, message=message, hint="is this a text file?")
    return Finding(file=file, message=f"not YAML: {' '.join(str(error).split())}")
