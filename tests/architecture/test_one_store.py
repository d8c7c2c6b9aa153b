"""What has to survive a crash is written by one store: nothing else appends to files, synchronizes them or puts them in place."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from tests.house.measure import read_modules

ROOT: Final = Path(__file__).parents[2]
STORE: Final = "common/gloc3/store/"
ALLOWED: Final = {
    "common/gloc3/log/record.py": "the log: one stream of many MB, synchronized by a thread of its own",
    "common/gloc3/log/disk_file.py": "the log's file",
    "common/gloc3/mavlink/services/files/ftp_files.py": "renames a file because a station asks for it",
    "onboard/gloc3_onboard/process/computer.py": "measures how fast the disk is",
    "onboard/gloc3_onboard/process/storage.py": "pictures: many a second, beside one list of them",
    "groundstation/gloc3_groundstation/desk/events_desk.py": "a copy for the operator, made anew on request",
    "groundstation/gloc3_groundstation/services/saving.py": "a download that goes on where it was interrupted",
    "groundstation/gloc3_groundstation/store/log_pull.py": "a download that goes on where it was interrupted",
    "sitl/gloc3_sitl/proof/search.py": "the flights of a search, flown again where a line is lost",
}
"""By module: why it does so itself."""
OF_OS: Final = ("fsync", "fdatasync", "replace", "rename")


def _does(nodes: Iterable[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module == "os":
            yield from (one.name for one in node.names if one.name in OF_OS)
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        given = [
            one.value for one in (*node.args, *(one.value for one in node.keywords)) if isinstance(one, ast.Constant)
        ]
        is_of_os = isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") == "os"
        if name in ("fsync", "fdatasync") or (is_of_os and name in OF_OS):
            yield name
        elif name == "open" and any(one in ("a", "ab", "a+", "ab+") for one in given):
            yield "append"
        elif (
            isinstance(node.func, ast.Attribute)
            and name in ("replace", "rename")
            and len(node.args) == 1
            and not node.keywords
        ):
            yield name  # of a path: of a text it has two arguments


def test_nothing_else_appends_synchronizes_or_puts_in_place() -> None:
    found = {str(module.path) for module in read_modules(ROOT).values() if any(_does(module.nodes))}
    own = {path for path in found if path.startswith(STORE)}
    assert own, "the store is found"
    assert found - own == set(ALLOWED)
