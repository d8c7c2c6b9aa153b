"""Collects plans of other people from clones of their repositories: `python -m tests.evidence.collect_plans FOLDER CLONE…`.

A clone is `NAME=PATH`; the newest commit of PATH counts. Files of one content are kept once. The folder is what the variable
GLOC3_PLANS names for `make evidence NAME=plans`.
"""

import re
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

from tests.evidence.plans import SOURCES

LIST = re.compile(rb"(RALLY\s|-?\d+\.\d+\s+-?\d+\.\d+\s*$)", re.MULTILINE)
"""How MAVProxy's lists of fence and rally points begin."""
SUFFIXES = (".plan", ".waypoints", ".txt", ".wpl", ".mission")


def git(clone: Path, *arguments: str) -> bytes:
    """What git answers; empty where it finds nothing."""
    return subprocess.run(["git", "-C", str(clone), *arguments], check=False, capture_output=True).stdout


def candidates(clone: Path) -> list[str]:
    """Files that may be plans, by their names and by what they begin with."""
    marked = {
        line.partition(":")[2] for line in git(clone, "grep", "-l", "-I", "QGC WPL", "HEAD").decode().splitlines()
    }
    names = git(clone, "ls-tree", "-r", "--name-only", "HEAD").decode(errors="replace").splitlines()
    lists = ("fence", "rally")
    found = (name for name in names if name.endswith(SUFFIXES))
    return [name for name in found if name in marked or name.endswith(".plan") or any(one in name for one in lists)]


def is_plan(name: str, data: bytes) -> bool:
    """Whether a file is one."""
    begin = data[:4000].lstrip(b"\xef\xbb\xbf")
    return begin.startswith(b"QGC WPL") or (name.endswith(".plan") and b"{" in begin) or LIST.match(begin) is not None


def main(folder: Path, clones: dict[str, Path]) -> None:
    """Fills the folder."""
    seen: set[str] = set()
    sources = []
    for short, clone in clones.items():
        count = 0
        for name in candidates(clone):
            data = git(clone, "show", f"HEAD:{name}")
            digest = sha256(data).hexdigest()
            if digest in seen or not is_plan(name, data):
                continue
            seen.add(digest)
            (folder / short / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / short / name).write_bytes(data)
            count += 1
        commit, date = git(clone, "log", "-1", "--format=%h %cs").decode().split()
        sources.append(f"{short} at {commit} ({date}): {count} files")
    (folder / SOURCES).write_text("\n".join(sources) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), {name: Path(path) for name, _, path in (one.partition("=") for one in sys.argv[2:])})
