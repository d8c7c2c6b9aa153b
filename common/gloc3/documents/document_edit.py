"""Edits of YAML texts in place: only the characters of a value change; comments, order and layout stay."""

import re
from typing import Final

import yaml

from gloc3.documents.document import Where
from gloc3.documents.yaml_nodes import LOADER
from gloc3.errors import Refused

_DASH: Final = re.compile(r"(\s*)-\s+")


def replaced(text: str, where: Where, value: str) -> str:
    """The text with another value at a path.

    Args:
        text: YAML that can be read.
        where: of the value.
        value: as it is written.

    Raises:
        Refused: there is no such value.
    """
    node = _node(text, where)
    return text[: node.start_mark.index] + value + text[_end(node) :]


def with_item(text: str, where: Where, index: int, value: str) -> str:
    """The text with one more entry in a list.

    Args:
        text: YAML that can be read.
        where: of the list.
        index: that the entry gets; the number of entries for the last.
        value: as it is written, in one line.

    Raises:
        Refused: there is no such list, or it is written in a form that cannot be extended.
    """
    node = _node(text, where)
    if not isinstance(node, yaml.SequenceNode) or not 0 <= index <= len(node.value):
        raise Refused(f"{_name(where)} is no list with a place {index + 1}")
    if node.flow_style:
        if index:
            end = _end(node.value[index - 1])
            return f"{text[:end]}, {value}{text[end:]}"
        begin = node.start_mark.index + 1
        return f"{text[:begin]}{value}{', ' if node.value else ''}{text[begin:]}"
    one = node.value[max(0, index - 1)]
    line = text.rfind("\n", 0, one.start_mark.index) + 1
    dash = _DASH.fullmatch(text[line : one.start_mark.index])
    if dash is None:
        raise Refused(f"{_name(where)} is written in a form that the map cannot extend; edit the text")
    row = f"{dash[0]}{value}\n"
    return _with_line(text, line if index == 0 else _after_line(text, _end(one)), row)


def without_item(text: str, where: Where, index: int) -> str:
    """The text without an entry of a list.

    Raises:
        Refused: there is no such entry.
    """
    node = _node(text, where)
    if not isinstance(node, yaml.SequenceNode) or not 0 <= index < len(node.value):
        raise Refused(f"{_name(where)} has no entry {index + 1}")
    one = node.value[index]
    if not node.flow_style:
        begin = text.rfind("\n", 0, one.start_mark.index) + 1
        if _DASH.fullmatch(text[begin : one.start_mark.index]) is None:
            raise Refused(f"{_name(where)} is written in a form that the map cannot shorten; edit the text")
        return text[:begin] + text[_after_line(text, _end(one)) :]
    if index + 1 < len(node.value):
        return text[: one.start_mark.index] + text[node.value[index + 1].start_mark.index :]
    begin = _end(node.value[index - 1]) if index else one.start_mark.index
    return text[:begin] + text[_end(one) :]


def with_key(text: str, where: Where, key: str, value: str, *, after: str = "", before: str = "") -> str:
    """The text with one more key in a mapping.

    Args:
        text: YAML that can be read.
        where: of the mapping.
        key: that is added.
        value: as it is written, in one line.
        after: the key that it follows; empty for the last, unless
        before: is the key that it goes before.

    Raises:
        Refused: there is no such mapping, or it has that key.
    """
    node = _node(text, where)
    if not isinstance(node, yaml.MappingNode) or not node.value:
        raise Refused(f"{_name(where)} is no mapping with entries")
    names = [str(name.value) for name, _ in node.value]
    if key in names:
        raise Refused(f"{_name(where)} has {key} already")
    if before:
        name = node.value[names.index(before)][0]
        begin = name.start_mark.index
        if node.flow_style:
            return f"{text[:begin]}{key}: {value}, {text[begin:]}"
        return text[:begin] + f"{key}: {value}\n{' ' * name.start_mark.column}" + text[begin:]
    name, last = node.value[names.index(after) if after else -1]
    end = _end(last)
    if node.flow_style:
        return f"{text[:end]}, {key}: {value}{text[end:]}"
    return _with_line(text, _after_line(text, end), f"{' ' * name.start_mark.column}{key}: {value}\n")


def _with_line(text: str, at: int, row: str) -> str:
    """The text with a line more; the last line of a file may lack its end."""
    is_open = bool(at) and text[at - 1] != "\n"
    return text[:at] + ("\n" + row.removesuffix("\n") if is_open else row) + text[at:]


def _after_line(text: str, at: int) -> int:
    """Where the line after a place begins."""
    end = text.find("\n", at)
    return len(text) if end < 0 else end + 1


def _node(text: str, where: Where) -> yaml.Node:
    try:
        node = yaml.compose(text, Loader=LOADER)
    except (yaml.YAMLError, RecursionError):
        node = None
    for step in where:
        if isinstance(node, yaml.MappingNode):
            node = next((value for name, value in node.value if name.value == step), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and 0 <= step < len(node.value):
            node = node.value[step]
        else:
            node = None
    if node is None:
        raise Refused(f"the text has no {_name(where)}")
    return node


def _end(node: yaml.Node) -> int:
    """Where a value ends; YAML's own mark of a block is where the next one begins."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        node = last[1] if isinstance(last, tuple) else last
    return int(node.end_mark.index)


def _name(where: Where) -> str:
    return ".".join(str(step + 1 if isinstance(step, int) else step) for step in where) or "mapping"
