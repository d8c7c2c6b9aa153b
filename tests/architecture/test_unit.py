"""The parts of the quick tests are all of them, and what is left out is not imported."""

import subprocess
import sys

import pytest
from tests.unit import OPTIONS, PARTS, ROOT

pytestmark = pytest.mark.thorough  # other processes


def collected(*arguments: str) -> set[str]:
    """The tests that pytest would run."""
    called = [sys.executable, "-m", "pytest", "--collect-only", "-p", "no:cacheprovider", *OPTIONS, *arguments]
    text = subprocess.run(called, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return {line for line in text.splitlines() if "::" in line}


def test_each_quick_test_is_in_one_part() -> None:
    folder = "tests/common/messages"
    parts = [collected(folder, f"--part={part}/{PARTS}") for part in range(PARTS)]
    assert all(parts)
    assert sum(map(len, parts)) == len(set.union(*parts))
    assert set.union(*parts) == collected(folder)


def test_a_file_of_thorough_tests_is_not_among_the_quick_ones() -> None:
    found = collected("tests/common/messages")
    assert found
    assert not any("test_wire.py" in test for test in found)
