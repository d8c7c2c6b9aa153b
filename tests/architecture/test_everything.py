"""How all tests are run: two groups of different priority, and what fails in wall time once more, alone."""

import os
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from tests.everything import run

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
