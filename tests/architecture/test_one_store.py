"""What has to survive a crash is written by one store: nothing else appends to files, synchronizes them or puts them in place."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

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


def _does(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        name, given = node.func.attr, [one.value for one in node.args if isinstance(one, ast.Constant)]
        if name in ("fsync", "fdatasync"):
            yield name
        elif name == "open" and any(isinstance(one, str) and one[:1] == "a" for one in given):
            yield "append"
        elif name in ("replace", "rename") and len(node.args) == 1 and not node.keywords:
            yield name  # of a path: of a text it has two arguments


def test_nothing_else_appends_synchronizes_or_puts_in_place() -> None:
    found = {
        str(path.relative_to(ROOT))
        for package in ("common", "onboard", "groundstation", "sitl")
        for path in (ROOT / package).rglob("*.py")
        if any(_does(ast.parse(path.read_text())))
    }
    own = {path for path in found if path.startswith(STORE)}
    assert own, "the store is found"
    assert found - own == set(ALLOWED)
