"""How all tests are run: two groups of different priority, and what fails in wall time once more, alone."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from tests.everything import ROOT, run

pytestmark = pytest.mark.thorough

CASES = """
import os
from pathlib import Path
import pytest

@pytest.mark.sockets
def test_in_wall_time():
    runs = Path(__file__).with_name("runs")
    with runs.open("a") as file:
        file.write("x")
    assert os.nice(0) == {priority}
    assert runs.read_text() == "xx"

def test_in_virtual_time():
    assert os.nice(0) == min(19, {priority} + 10)
    session = Path("/proc/self/autogroup")
    assert not session.exists() or session.read_text().split()[-1] == "10"
    assert {passes}
"""


def outcomes(report: Path) -> dict[str, str]:
    return {case.get("name", ""): "".join(child.tag for child in case) for case in ET.parse(report).iter("testcase")}


@pytest.mark.parametrize("passes", [True, False])
def test_wall_time_goes_first_and_gets_a_second_chance_alone(
    passes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "test_cases.py").write_text(CASES.format(priority=os.nice(0), passes=passes))
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = sockets\n")
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    assert run(tmp_path / "reports", tmp_path) == (0 if passes else 1)
    assert outcomes(tmp_path / "reports" / "wall.xml") == {"test_in_wall_time": "failure"}
    assert outcomes(tmp_path / "reports" / "alone.xml") == {"test_in_wall_time": ""}
    assert outcomes(tmp_path / "reports" / "virtual.xml") == {"test_in_virtual_time": "" if passes else "failure"}


def collected(*arguments: str) -> subprocess.CompletedProcess[str]:
    """How pytest ends that only collects, and what it prints."""
    called = [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", *arguments]
    return subprocess.run(called, cwd=ROOT, check=False, capture_output=True, text=True)


def test_files_without_tests_in_wall_time_are_not_imported_and_none_of_these_is_left_out() -> None:
    folders = "tests/sitl/cases", "tests/common/exchange"
    found, all_of_them = (
        [line for line in collected("-m", marks, *folders).stdout.splitlines() if "::" in line]
        for marks in ("sockets", "sockets and not outside")
    )
    assert found == all_of_them
    assert any("test_some_flights" in test for test in found), "its marks are imported"
    assert "deselected" not in collected("-m", "sockets", "tests/common/messages").stdout


def test_a_mark_that_the_text_does_not_show_is_refused(tmp_path: Path) -> None:
    hidden = tmp_path / "test_hidden.py"
    hidden.write_text("import pytest\npytestmark = getattr(pytest.mark, 'sock' 'ets')\n\ndef test_it(): ...\n")
    done = collected("-p", "tests.conftest", "-m", "not sockets", str(hidden))
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert "test_hidden.py: write it there" in done.stderr


def test_no_threads_of_algebra_wait_for_each_other_while_others_want_the_processor() -> None:
    program = "import os, numpy; print(len(os.listdir('/proc/self/task')))"
    assert subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout == "1\n"
