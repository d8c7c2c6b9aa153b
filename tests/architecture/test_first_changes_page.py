"""The changes that `docs/newcomer.md` shows can be made: each is applied to a copy of the source, and its own test passes."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
CHANGES = re.findall(r"^```diff\n(.*?)^```$", (ROOT / "docs/newcomer.md").read_text(), re.MULTILINE | re.DOTALL)
CHANGED = ("common", "onboard", "tests/onboard")


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of what they change."""
    for name in CHANGED:
        shutil.copytree(ROOT / name, tmp_path / name)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "change", CHANGES, ids=re.findall(r"^## (.+)$", (ROOT / "docs/newcomer.md").read_text(), re.MULTILINE)
)
def test_a_change_can_be_made_and_its_test_passes(change: str, copy: Path) -> None:
    tests = re.findall(r"^\+\+\+ b/(tests/\S+)$", change, re.MULTILINE)
    added = re.findall(r"^\+def (test_\w+)", change, re.MULTILINE)
    assert tests
    assert added
    call = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests, "-k", " or ".join(added)]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(str(place) for place in (copy / "common", copy / "onboard", copy, ROOT)),
    }
    subprocess.run(["git", "apply"], cwd=copy, input=change, check=True, text=True)
    done = subprocess.run(call, cwd=copy, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
