"""The notes of a version, and what stands against its release."""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.house.notice import ROOT

NOTES: Final = "docs/release-notes.md"
CHANGES: Final = "CHANGELOG.md"
PLACES: Final = {
    CHANGES: r"^## (\S+) \((?:unreleased|\d{4}-\d\d-\d\d)\)$",
    NOTES: r"^## (\S+)$",
    "common/gloc3/__init__.py": r'^__version__ = "(.*)"$',
    "tests/release/Dockerfile": r"^ARG VERSION=(.*)$",
}
"""Files that name the version beside pyproject.toml; the first match is the newest one's."""
_LINK: Final = re.compile(r"\[([^\]]*)\]\([^)]*\)")


def obstacles(version: str, *, is_tagged: bool, root: Path = ROOT) -> Iterator[str]:
    """The reasons for which a version cannot be released.

    Args:
        version: that of pyproject.toml.
        is_tagged: whether this is the commit of the version's tag, which has to be complete.
        root: the project's folder.
    """
    for name, pattern in PLACES.items():
        found = re.search(pattern, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
        if found is None or found[1] != version:
            yield f"{name} is for version {found[1] if found else '(none)'}, pyproject.toml for {version}"
        elif is_tagged and "(unreleased)" in found[0]:
            yield f"{name} has no date for {version}, although this commit is tagged: write it in place of (unreleased)"


def notes(version: str, root: Path = ROOT) -> str:
    """The notes of a version for a reader who has no other page: links are their texts."""
    text = (root / NOTES).read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(version)}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert found is not None, "obstacles() has found it"
    return f"# GLOC3 {version}\n{_LINK.sub(lambda link: link[1], found[1])}"


def is_tagged(version: str) -> bool:
    """Whether the tag of a version names this commit."""
    called = ["git", "tag", "--points-at", "HEAD"]
    done = subprocess.run(called, cwd=ROOT, capture_output=True, check=False, text=True)
    return f"v{version}" in done.stdout.split()
