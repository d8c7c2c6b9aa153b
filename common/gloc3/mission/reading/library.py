"""Files that a mission names and that are sent with it: libraries of definitions, and plans of other programs.

A mission is sent as one text. So its `include: [survey.yaml]` is replaced at the sender by `include: {survey.yaml:
CONTENT}`, and the `plan: field.plan` of a task likewise, with the number of lines unchanged: onboard, findings have the
same positions.
"""

import json
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Final

import yaml

from gloc3.documents import schema
from gloc3.documents.document import Document, Where, load_bytes, parse
from gloc3.documents.format_version import KEY, check_format
from gloc3.documents.yaml_nodes import LOADER
from gloc3.errors import Finding, InputError, Refused
from gloc3.mission.model.model import LibraryFile

MAX_LIBRARIES: Final = 20


def bundled(text: str, file: Path) -> str:
    """The text of a mission with the libraries that it includes and the plans of its tasks, each relative to its file.

    Raises:
        InputError: one is not there, or cannot be read; with the place where it is named.
    """
    if "include" not in text and "plan:" not in text:
        return text
    try:
        document = parse(text, str(file))
    except InputError:
        return text  # what is wrong with it is found when it is read
    findings: list[Finding] = []
    contents: list[tuple[Where, dict[str, str]]] = []
    block = document.root.children.get("include")
    if block is not None and isinstance(block.value, list):
        names = [(("include", index), name) for index, name in enumerate(block.value[:MAX_LIBRARIES])]
        contents.append((("include",), _contents(names, document, file, findings)))
    for where, name in _named_plans(document):
        contents.append((where, _contents([(where, name)], document, file, findings)))
    if findings:
        raise InputError(findings)
    return _carrying(text, contents)


def _named_plans(document: Document) -> list[tuple[Where, str]]:
    """The plans that tasks name by their files."""
    found: list[tuple[Where, str]] = []
    for group in ("tasks", "contingencies"):
        tasks = document.root.children.get(group)
        for name, task in tasks.children.items() if tasks is not None else ():
            plan = task.children.get("plan")
            if plan is not None and isinstance(plan.value, str):
                found.append(((group, name, "plan"), plan.value))
    return found


def _contents(
    names: Sequence[tuple[Where, object]], document: Document, file: Path, findings: list[Finding]
) -> dict[str, str]:
    """The content of files by their names; what cannot be read is a finding."""
    found: dict[str, str] = {}
    for where, name in names:
        try:
            relative = _relative(name)
            found[relative] = load_bytes(file.parent / relative).decode("utf-8-sig")
        except UnicodeDecodeError:
            findings.append(document.finding(where, f"{name} is not UTF-8 text"))
        except Refused as refusal:
            findings.append(document.finding(where, str(refusal), "write it relative to the mission"))
        except InputError as error:
            findings.append(document.finding(where, f"{name} {error.findings[0].message}"))
    return found


def library_documents(document: Document) -> list[Document]:
    """The libraries that a mission carries.

    Raises:
        InputError: one is no library; or they are named only, and not carried.
    """
    block = document.root.children.get("include")
    if block is None or block.value is None:
        return []
    if not isinstance(block.value, dict):
        message = "the included libraries are missing"
        hint = "use the mission's file: its libraries are sent with it"
        raise InputError([document.finding(("include",), message, hint)])
    found: list[Document] = []
    findings: list[Finding] = []
    folder = PurePosixPath(document.file).parent
    for name, content in block.value.items():
        try:
            library = parse(str(content), str(folder / name))
            check_format(library)
        except InputError as error:
            findings += error.findings
            continue
        if isinstance(library.value, dict):
            unknown = {key: node for key, node in library.root.children.items() if key not in ("define", "about", KEY)}
            for key in unknown:
                message, hint = f"a library has no key {key!r}", "its keys are define and about"
                findings.append(library.finding((key,), message, hint, at_key=True))
            if "define" not in library.root.children:
                schema.check(library.root, LibraryFile, library.file, findings)
            found.append(library)
        else:
            findings.append(library.finding((), "a library is a mapping", "begin with 'define:'"))
    if findings:
        raise InputError(findings)
    return found


def _relative(name: object) -> str:
    if not isinstance(name, str) or not name or PurePosixPath(name).is_absolute():
        raise Refused(f"{name} is not a relative path")
    return name


def _carrying(text: str, contents: Sequence[tuple[Where, dict[str, str]]]) -> str:
    """The text with the values at some places replaced by mappings of names to contents; as many lines as before."""
    root = yaml.compose(text, Loader=LOADER)  # as it was read: PyYAML's other one refuses other texts
    assert root is not None
    replaced = [(_node_at(root, where), carried) for where, carried in contents]
    for value, carried in sorted(replaced, key=lambda one: one[0].start_mark.index, reverse=True):
        start, end = value.start_mark.index, value.end_mark.index
        lines = text[start:end].count("\n")
        text = text[:start] + json.dumps(carried, ensure_ascii=False) + "\n" * lines + text[end:]
    return text


def _node_at(root: yaml.Node, where: Where) -> yaml.Node:
    node = root
    for step in where:
        assert isinstance(node, yaml.MappingNode)
        node = next(value for key, value in node.value if key.value == step)
    return node
