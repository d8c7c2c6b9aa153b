"""Expands task definitions: `define`, `use` and `with` become plain tasks before all other reading.

A parameter is a whole value (`$speed` or `${speed}`); it is replaced by a value of its type, never by pasted text.
Every value keeps its position in the source, so that findings name both the use and the definition.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from gloc3.documents import schema
from gloc3.documents.document import Document, Where
from gloc3.documents.yaml_nodes import MAX_NODES, YamlNode
from gloc3.errors import Finding, InputError, nearest
from gloc3.mission.model.model import DefinitionFile, ParameterFile
from gloc3.mission.model.patterns import ARRIVE
from gloc3.mission.reading.library import library_documents

_ALONE: Final = re.compile(r"\$(?:\{([A-Za-z][A-Za-z0-9_-]*)\}|([A-Za-z][A-Za-z0-9_-]*))")
_INSIDE: Final = re.compile(r"\$\{?[A-Za-z]")
NAME_MAX: Final = 32
RETURN: Final = "return_home"
RETURN_SUFFIX: Final = "_return"
_BEGIN_KEYS: Final = ("after", "when", "otherwise")
_USE_KEYS: Final = ("use", "with")
_OWN_KEYS: Final = ("parameters", "about")
TASKS: Final = ("tasks", "contingencies")
"""Keys of a mission file that contain tasks."""


@dataclass(slots=True)
class _Definition:
    """One entry of a `define`."""

    name: str
    node: YamlNode
    file: str
    place: tuple[int, int]
    parameters: dict[str, ParameterFile] = field(default_factory=dict)
    is_usable: bool = True

    @property
    def at(self) -> str:
        return f"{self.file}:{self.place[0]}:{self.place[1]}"


def expanded(document: Document, findings: list[Finding]) -> Document:
    """The document with every `use` replaced by its definition; errors are appended to the findings."""
    definitions = _definitions(document, findings)
    root, room = _copy(document.root), [MAX_NODES]
    for key in TASKS:
        tasks = root.children.get(key)
        if tasks is None or not isinstance(tasks.value, dict):
            continue
        tasks = _copy(tasks)
        for name, task in list(tasks.children.items()):
            made = task
            if isinstance(task.value, dict) and "use" in task.children:
                made = _used((key, str(name)), task, definitions, document, findings, room)
            made = _arrivals(made)
            if made is not task:
                tasks.put(name, made)
        root.put(key, tasks)
    return Document(document.file, root)


def _definitions(document: Document, findings: list[Finding]) -> dict[str, _Definition]:
    """All definitions by name: the libraries' first, then the mission's own."""
    found: dict[str, _Definition] = {}
    try:
        libraries = library_documents(document)
    except InputError as error:
        findings += error.findings
        libraries = []
    for source in (*libraries, document):
        block = source.root.children.get("define")
        if block is None or not isinstance(block.value, dict):
            continue
        for name, node in block.children.items():
            one = _Definition(str(name), node, source.file, block.key_places[str(name)])
            if (earlier := found.get(one.name)) is not None:
                message = f"{one.name!r} is already defined at {earlier.at}"
                findings.append(source.finding(("define", name), message, "give it another name", at_key=True))
                continue
            found[one.name] = one
            _read_definition(one, source, findings, is_library=source is not document)
    return found


def _read_definition(one: _Definition, source: Document, findings: list[Finding], *, is_library: bool) -> None:
    """Reads the parameters, and checks that the definition refers only to them."""
    if is_library:  # the mission's own are checked with the rest of its file
        before = len(findings)
        schema.check(one.node, DefinitionFile, source.file, findings, one.name)
        one.is_usable = len(findings) == before
    elif schema.check(one.node, DefinitionFile, source.file, [], one.name) is None:
        one.is_usable = False
    rows = one.node.children.get("parameters")
    if rows is not None and isinstance(rows.value, dict):
        for name, row in rows.children.items():
            read = schema.check(row, ParameterFile, source.file, [], str(name))
            if read is None:
                one.is_usable = False
                continue
            one.parameters[str(name)] = read
            default = row.children.get("default")
            if default is not None and default.value is not None and (wrong := _misfit(read, default.value)):
                where: Where = ("define", one.name, "parameters", name, "default")
                findings.append(source.finding(where, f"{name}: {wrong}"))
    named: set[str] = set()
    for key, child in one.node.children.items():
        if key not in _OWN_KEYS:
            for node in child.descendants():
                parameter = _parameter(node.value)
                if parameter is None and isinstance(node.value, str) and _INSIDE.search(node.value):
                    hint = "a parameter stands for a whole value"
                    findings.append(_at(node, source.file, f"a parameter inside the text {node.value[:40]!r}", hint))
                elif parameter is not None and parameter not in one.parameters:
                    message, hint = (
                        f"{one.name!r} has no parameter {parameter!r}",
                        nearest(parameter, [*one.parameters]),
                    )
                    findings.append(_at(node, source.file, message, hint))
                named |= {parameter} if parameter is not None else set()
    for name in one.parameters:
        if name not in named:
            where = ("define", one.name, "parameters", name)
            findings.append(source.finding(where, f"parameter {name!r} is never used", at_key=True, is_warning=True))


def _used(
    where: Where,
    task: YamlNode,
    definitions: Mapping[str, _Definition],
    document: Document,
    findings: list[Finding],
    room: list[int],
) -> YamlNode:
    """The task that results from a use of a definition; the use itself where it cannot be expanded."""
    use = task.children["use"].value
    one = definitions.get(use) if isinstance(use, str) else None
    if one is None:
        hint = nearest(str(use), list(definitions)) if definitions else "define it, or include its library"
        findings.append(document.finding((*where, "use"), f"nothing is defined as {use!r}", hint))
        return task
    if "actions" in task.children:
        message = f"{where[-1]!r} has both use and actions"
        findings.append(document.finding((*where, "actions"), message, "move the actions to another task", at_key=True))
        return task
    values = _values(where, task, one, document, findings)
    if values is None or not one.is_usable:
        return task
    made = YamlNode({}, task.line, task.column)
    for key, child in task.children.items():
        if key not in _USE_KEYS:
            made.put(key, child, task.key_places[str(key)])
    used_at = f"in {where[-1]!r}, {document.file}:{task.line}:{task.column}"
    for key, child in one.node.children.items():
        if key not in (*_OWN_KEYS, *made.children):
            clone = _clone(child, values, one.file if one.file != document.file else "", used_at, room)
            made.put(key, clone, one.node.key_places[str(key)])
    if room[0] < 0:
        findings.append(
            document.finding(where, f"the expanded definitions make more than {MAX_NODES:,} values", at_key=True)
        )
        return task
    return made


def _arrivals(task: YamlNode) -> YamlNode:
    """The task with each `arrive` expanded to two actions: a return home, and the end of the motion there."""
    actions = task.children.get("actions")
    if actions is None or not any(ARRIVE in action.children for action in actions.children.values()):
        return task
    found = YamlNode({}, actions.line, actions.column, actions.file, actions.note)
    for name, action in actions.children.items():
        place = actions.key_places[str(name)]
        given = action.children.get(ARRIVE)
        if given is None or given.value not in (None, {}) or RETURN in action.children:
            found.put(name, action, place)
            continue
        first, last = _like(action), _like(action)
        for key, child in action.children.items():
            if key != ARRIVE:
                first.put(key, child, action.key_places[str(key)])
            if key not in (ARRIVE, *_BEGIN_KEYS):
                last.put(key, child, action.key_places[str(key)])
        back = f"{str(name)[: NAME_MAX - len(RETURN_SUFFIX)]}{RETURN_SUFFIX}"
        while back in actions.children:
            back = back[:-1]
        first.put(RETURN, _put(given, {}), action.key_places[ARRIVE])
        last.put("land", _put(given, {}), action.key_places[ARRIVE])
        after = _put(given, [])
        after.put(0, _put(given, back))
        last.put("after", after, action.key_places[ARRIVE])
        found.put(back, first, place)
        found.put(name, last, place)
    made = _copy(task)
    made.put("actions", found)
    return made


def _like(node: YamlNode) -> YamlNode:
    return YamlNode({}, node.line, node.column, node.file, node.note)


def _put(node: YamlNode, value: Any) -> YamlNode:
    """A node with another value, at the position of the original."""
    return YamlNode(value, node.line, node.column, node.file, node.note)


def _values(
    where: Where, task: YamlNode, one: _Definition, document: Document, findings: list[Finding]
) -> dict[str, YamlNode] | None:
    """Value of each parameter; None where one is missing or invalid."""
    given = task.children.get("with")
    rows = given.children if given is not None and isinstance(given.value, dict) else {}
    before = len(findings)
    if given is not None and not isinstance(given.value, dict):
        findings.append(document.finding((*where, "with"), "with is a mapping of parameters to values"))
    for name in rows:
        if name not in one.parameters:
            message = f"{one.name!r} has no parameter {name!r} (it is defined at {one.at})"
            hint = nearest(str(name), list(one.parameters))
            findings.append(document.finding((*where, "with", name), message, hint, at_key=True))
    values: dict[str, YamlNode] = {}
    for name, parameter in one.parameters.items():
        row = rows.get(name)
        if row is None:
            default = one.node.children["parameters"].children[name].children.get("default")
            if default is None:
                message = f"{one.name!r} needs {name!r}, {parameter.wanted} (it is defined at {one.at})"
                findings.append(document.finding((*where, "use"), message, f"with: {{{name}: …}}"))
                continue
            values[name] = default
        else:
            if wrong := _misfit(parameter, row.value):
                message = f"{name}: {wrong} (it is defined at {one.at})"
                findings.append(document.finding((*where, "with", name), message))
            values[name] = _noted(row, f"{name!r} of {one.name!r}, {one.at}")
    return values if len(findings) == before else None


def _misfit(parameter: ParameterFile, value: Any) -> str:
    """Why a value is not of a parameter's kind; empty where it is."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    fits = {
        "number": is_number,
        "whole": isinstance(value, int) and not isinstance(value, bool),
        "text": isinstance(value, str),
        "flag": isinstance(value, bool),
        "choice": value in parameter.of,
        "point": _is_point(value),
        "points": isinstance(value, list) and bool(value) and all(_is_point(one) for one in value),
        "any": True,
    }[parameter.kind]
    if not fits:
        return f"{str(value)[:40]!r} is not {parameter.wanted}"
    if is_number and parameter.at_least is not None and value < parameter.at_least:
        return f"{value:g} is below the minimum of {parameter.at_least:g}"
    if is_number and parameter.at_most is not None and value > parameter.at_most:
        return f"{value:g} is above the maximum of {parameter.at_most:g}"
    return ""


def _is_point(value: Any) -> bool:
    numbers = isinstance(value, list) and all(isinstance(n, int | float) and not isinstance(n, bool) for n in value)
    return numbers and 2 <= len(value) <= 3


def _parameter(value: Any) -> str | None:
    """The parameter that a value refers to; None for any other value."""
    match = _ALONE.fullmatch(value) if isinstance(value, str) else None
    return None if match is None else match[1] or match[2]


def _clone(node: YamlNode, values: Mapping[str, YamlNode], file: str, note: str, room: list[int]) -> YamlNode:
    """A copy with the parameters replaced, each value with the place that it comes from."""
    name = _parameter(node.value)
    if name is not None and name in values:
        put = values[name]
        # a default stands in the definition; what was given stands in the mission, and says so itself
        return put if put.note else _clone(put, {}, file, note, room)
    room[0] -= 1
    made = YamlNode(node.value, node.line, node.column, node.file or file, note)
    if isinstance(node.value, dict | list):
        made.value = {} if isinstance(node.value, dict) else []
        made.key_places = dict(node.key_places)
        for key, child in node.children.items():
            if room[0] < 0:
                break
            made.put(key, _clone(child, values, file, note, room))
    return made


def _noted(node: YamlNode, note: str) -> YamlNode:
    """A copy with a note on its purpose."""
    made = YamlNode(node.value, node.line, node.column, node.file, note)
    made.key_places = node.key_places
    made.children = {key: _noted(child, note) for key, child in node.children.items()}
    return made


def _copy(node: YamlNode) -> YamlNode:
    """A copy with its own mapping of children."""
    made = YamlNode(dict(node.value) if isinstance(node.value, dict) else node.value, node.line, node.column, node.file)
    made.children, made.key_places = dict(node.children), dict(node.key_places)
    return made


def _at(node: YamlNode, file: str, message: str, hint: str) -> Finding:
    return Finding(file=node.file or file, line=node.line, column=node.column, message=message, hint=hint)
