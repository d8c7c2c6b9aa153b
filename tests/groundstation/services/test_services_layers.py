"""The services know no Textual."""

import ast
from pathlib import Path

import pytest

import gloc3_groundstation.services

pytestmark = pytest.mark.thorough

ROOT = Path(gloc3_groundstation.services.__path__[0])


def imported(file: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def test_no_service_knows_textual_or_rich() -> None:
    for file in ROOT.glob("*.py"):
        assert not any(name.startswith(("textual", "rich", "gloc3_groundstation.tui")) for name in imported(file)), file
