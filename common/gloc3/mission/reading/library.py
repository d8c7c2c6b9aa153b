"""Libraries of definitions: files that a mission includes, and that are sent with it.

A mission is sent as one text. So its `include: [survey.yaml]` is replaced at the sender by `include: {survey.yaml:
CONTENT}`, with the number of lines unchanged: onboard, findings have the same positions.
"""

import json
from pathlib import Path, PurePosixPath
from typing import Final

import yaml

from gloc3.documents import schema
from gloc3.documents.document import Document, load_bytes, parse
from gloc3.errors import Finding, InputError, Refused
from gloc3.mission.model.model import LibraryFile

MAX_LIBRARIES: Final = 20


def bundled(text: str, file: Path) -> str:
    """The text of a mission with the libraries that it includes, each relative to the mission's own file.

    Raises:
        InputError: a library is not there, or cannot be read; with the place where it is included.
    """
    if "include" not in text:
        return text
    try:
        document = parse(text, str(file))
    except InputError:
        return text  # what is wrong with it is found when it is read
    block = document.root.children.get("include")
    if block is None or not isinstance(block.value, list):
        return text
    contents: dict[str, str] = {}
    findings: list[Finding] = []
    for index, name in enumerate(block.value[:MAX_LIBRARIES]):
        try:
            relative = _relative(name)
            contents[relative] = load_bytes(file.parent / relative).decode("utf-8-sig")
        except UnicodeDecodeError:
            findings.append(document.finding(("include", index), f"{name} is not UTF-8 text"))
        except Refused as refusal:
            findings.append(document.finding(("include", index), str(refusal), "write it relative to the mission"))
        except InputError as error:
            findings.append(document.finding(("include", index), f"{name} {error.findings[0].message}"))
    if findings:
        raise InputError(findings)
    return _carrying(text, contents)


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
        except InputError as error:
            findings += error.findings
            continue
        if isinstance(library.value, dict):
            unknown = {key: node for key, node in library.root.children.items() if key not in ("define", "about")}
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


def _carrying(text: str, contents: dict[str, str]) -> str:
    """The text with the value of `include` replaced; as many lines as before."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    value = next(value for key, value in root.value if key.value == "include")
    start, end = value.start_mark.index, value.end_mark.index
    lines = text[start:end].count("\n")
    return text[:start] + json.dumps(contents, ensure_ascii=False) + "\n" * lines + text[end:]
