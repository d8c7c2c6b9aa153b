"""Platform files that extend others: `extends: multirotor`, then only the differences.

Mappings are merged key by key, components row by row (by name); lists and single values replace those of the base, and
null removes them. Every value keeps its file, line and column, so that findings point there.
"""

from os.path import relpath
from pathlib import Path
from typing import Final

from gloc3.documents.document import Document, load_bytes, parse
from gloc3.documents.yaml_nodes import YamlNode
from gloc3.errors import Finding, InputError, nearest
from gloc3.installed import installed_points

EXTENDS: Final = "extends"
BASES: Final = "bases"
"""Folder next to the platform files for bases: platforms that are incomplete on their own."""


def platform_files() -> dict[str, Path]:
    """The files of all platforms that installed packages bring, by the files' names."""
    return _installed("*.yaml")


def installed_platforms(name: str) -> list[Path]:
    """The files of that name in all installed packages; `platform_files` has the last one."""
    return [folder / f"{name}.yaml" for folder in _folders() if (folder / f"{name}.yaml").is_file()]


def base_files() -> dict[str, Path]:
    """The files that a platform file can extend by their names: the bases of installed packages, and their platforms."""
    return platform_files() | _installed(f"{BASES}/*.yaml")


def _installed(pattern: str) -> dict[str, Path]:
    return {file.stem: file for folder in _folders() for file in sorted(folder.glob(pattern))}


def _folders() -> list[Path]:
    return [Path(folder) for point in installed_points("gloc3.platforms") for folder in point.load().__path__]


def completed(document: Document, extending: tuple[Path, ...] = ()) -> Document:
    """The complete platform of a document: its base, with its own values on top.

    Args:
        document: as written; returned unchanged where it extends nothing.
        extending: the chain of extending files.

    Raises:
        InputError: a base does not exist, extends itself, or has errors; or a row changes a component that no base has.
    """
    where = document.root.children.get(EXTENDS)
    if where is None:
        return document
    file = Path(document.file)
    base_file = _base_file(document, where)
    chain = (*extending, file.resolve())
    if base_file.resolve() in chain:
        names = " -> ".join(one.name for one in (*chain, base_file))
        raise InputError([document.finding((EXTENDS,), f"the files extend each other: {names}")])
    base = completed(parse(load_bytes(base_file), str(base_file)), chain)
    if not (isinstance(base.root.value, dict) and isinstance(document.root.value, dict)):
        raise InputError([document.finding((EXTENDS,), f"{base_file.name} is not a mapping")])
    _move_files(base, file)
    for node in base.root.descendants():
        node.file = node.file or base.file
    own = YamlNode(dict(document.root.value), document.root.line, document.root.column)
    own.children, own.key_places = dict(document.root.children), document.root.key_places
    del own.children[EXTENDS]
    findings: list[Finding] = []
    root = _merged(base.root, own)
    rows, changes = base.root.children.get("components"), own.children.get("components")
    if rows is not None and changes is not None and isinstance(rows.value, list) and isinstance(changes.value, list):
        root.put("components", _merged_rows(rows, changes, document, findings), own.key_places["components"])
    if findings:
        raise InputError(sorted(findings))
    return Document(document.file, root, (base_file, *base.bases))


def _base_file(document: Document, where: YamlNode) -> Path:
    name = where.value
    if not isinstance(name, str):
        raise InputError([document.finding((EXTENDS,), "extends needs the name of a base or platform, or a file")])
    path = Path(name)
    if path.suffix:
        path = Path(document.file).parent / path
        if not path.is_file():
            raise InputError([document.finding((EXTENDS,), f"there is no file {name!r} beside this one")])
        return path
    known = base_files()
    if name not in known:
        hint = nearest(name, sorted(known))
        raise InputError([document.finding((EXTENDS,), f"no base or platform is called {name!r}", hint)])
    return known[name]


def _move_files(base: Document, file: Path) -> None:
    """Makes the base's calibration files, keys and map, which are relative to it, relative to the file that extends it."""
    folder = relpath(Path(base.file).parent, file.parent)
    if folder == ".":
        return
    rows = [base.root.children[name] for name in ("cameras", "members") if name in base.root.children]
    places = [(base.root, "known_map"), *((row, name) for row in rows for name in row.children)]
    for holder, name in places:
        node = holder.children.get(name)
        if node is not None and isinstance(node.value, str) and node.value and not Path(node.value).is_absolute():
            node.value = holder.value[name] = f"{folder}/{node.value}"


def _merged(base: YamlNode, own: YamlNode) -> YamlNode:
    """Merges a mapping onto another; a new entry goes after the one that precedes it in the file, or first."""
    made = YamlNode({}, own.line, own.column, own.file)
    order, last = [str(key) for key in base.children], ""
    for name in map(str, own.children):
        if name not in base.children:
            order.insert(order.index(last) + 1 if last else 0, name)
        last = name
    for key in order:
        child, over = base.children.get(key), own.children.get(key)
        if over is None and child is not None:
            made.put(key, child, base.key_places[key])
        elif over is not None and (over.value is not None or child is None):
            if child is not None and isinstance(child.value, dict) and isinstance(over.value, dict):
                over = _merged(child, over)
            made.put(key, over, own.key_places[key])
    return made


def _merged_rows(base: YamlNode, own: YamlNode, document: Document, findings: list[Finding]) -> YamlNode:
    """Merges the file's rows onto the base's; a new one goes after the row that precedes it in the file, or last."""
    rows: dict[str, YamlNode] = {}
    for index, row in base.children.items():
        name = _name_of(row)
        rows[f"{name} {index}" if not name or name in rows else name] = row
    order, last, written = list(rows), "", set[str]()
    for index, row in own.children.items():
        name = _name_of(row)
        is_first = name not in written
        written.add(name)
        if name in rows and is_first:
            if "class" in row.value and row.value["class"] is None:
                order.remove(name)
                continue
            rows[name] = _merged(rows[name], row)
        else:
            if isinstance(row.value, dict) and name and "class" not in row.value:
                message, hint = f"there is no component {name!r} to change", nearest(name, [*rows])
                findings.append(document.finding(("components", index), message, hint))
            key = name if name and is_first else f"{name} {index}"  # what is wrong with it is found later, at its place
            rows[key] = row
            order.insert(order.index(last) + 1 if last else len(order), key)
            name = key
        last = name
    made = YamlNode([], own.line, own.column, own.file)
    for index, name in enumerate(order):
        made.put(index, rows[name])
    return made


def _name_of(row: YamlNode) -> str:
    return str(row.value.get("name", "")) if isinstance(row.value, dict) else ""
