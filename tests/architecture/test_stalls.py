"""Which tests are run again: those in wall time that fail, once, or twice where the machine stood still; and no others."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

CASE = """
import os, subprocess
from pathlib import Path
import pytest

RUNS = Path(__file__).with_name("runs")

@pytest.fixture
def fresh():
    RUNS.open("a").write("x")
    yield RUNS.read_text()

{mark}
def test_it(fresh):
    if {stalls} and fresh == "x":
        subprocess.Popen(["bash", "-c", f"sleep 1.5; kill -CONT {{os.getpid()}}"])
        os.kill(os.getpid(), 19)
    assert {passes}
"""
SOCKETS = "@pytest.mark.sockets"


@pytest.mark.parametrize(
    ("mark", "stalls", "passes", "runs", "code"),
    [
        (SOCKETS, "True", "fresh != 'x'", 2, 0),
        (SOCKETS, "True", "False", 2, 1),
        (SOCKETS, "False", "fresh != 'x'", 2, 0),
        (SOCKETS, "False", "False", 2, 1),
        ("", "True", "fresh != 'x'", 1, 1),
    ],
)
def test_what_fails_in_wall_time_is_run_again_and_that_is_told(
    mark: str, stalls: str, passes: str, runs: int, code: int, tmp_path: Path
) -> None:
    (tmp_path / "test_case.py").write_text(CASE.format(mark=mark, stalls=stalls, passes=passes))
    (tmp_path / "conftest.py").write_text("import tests.stalls\ntests.stalls.STALL_S = 1.0\n")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = sockets\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "tests.stalls", "-p", "no:cacheprovider", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == code, done.stdout
    assert (tmp_path / "runs").read_text() == runs * "x"
    assert ("RUN AGAIN" in done.stdout) == (runs == 2 and code == 0)
