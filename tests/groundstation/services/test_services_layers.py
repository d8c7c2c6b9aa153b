"""The services know no Textual, and MAVSDK is loaded in its own process alone."""

import ast
from pathlib import Path

import pytest

import gloc3_groundstation.services

pytestmark = pytest.mark.thorough

ROOT_NAME = gloc3_groundstation.services.__name__
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


def test_mavsdk_is_loaded_by_the_helper_alone() -> None:
    users = {file.name for file in ROOT.parent.glob("**/*.py") if any(n.startswith("mavsdk") for n in imported(file))}
    assert users == {"mavsdk_helper.py"}


def test_a_service_has_one_way_to_the_autopilot() -> None:
    by_mavsdk = {file.name for file in ROOT.glob("*.py") if f"{ROOT_NAME}.raw" in imported(file)}
    assert by_mavsdk == {"plans.py", "vehicle.py"}  # the service, and where it is made
    tree = ast.parse((ROOT / "plans.py").read_text())
    ours = {
        node.func.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and ast.unparse(node.func.value) == "self._client"
    }
    assert ours == {"clear", "cancel"}, "what MAVSDK cannot do, and nothing that it does"
