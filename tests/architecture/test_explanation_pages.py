"""The pages that explain: what they name exists, and what is made from the code or from evidence is as it is there."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest
from tests.house import deaths, performance

from gloc3.messages import frames
from gloc3.messages.units import UNITS
from gloc3_sitl.proof.static_proof import StaticCell, StaticProof

ROOT = Path(__file__).parents[2]
PAPER = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAPER.splitlines()
    if line.startswith("| ") and not line.startswith(("| the paper", "| ---"))
]


def test_what_happens_when_something_dies_is_the_static_proof() -> None:
    assert deaths.PAGE.read_text(encoding="utf-8") == deaths.page(), "run `make docs`"


def test_components_with_one_answer_share_a_row_and_a_missing_answer_is_shown() -> None:
    cells = [
        StaticCell(component=name, phase=phase, answer=f"policy land (on_fault of {name}: land)")
        for name in ("pose", "hold")
        for phase in ("up.climb", "up.wait")
    ]
    cells += [
        StaticCell(component="camera", phase="up.climb", answer="it goes on"),
        StaticCell(component="camera", phase="up.wait", answer="none", problem="nothing is left"),
    ]
    assert list(deaths.answers(StaticProof(platform="p", mission="m", cells=tuple(cells), findings=()))) == [
        ("`pose`, `hold`", "all actions", "policy land (its `on_fault`: land)"),
        ("`camera`", "`up.climb`", "it goes on"),
        ("`camera`", "`up.wait`", "none; no answer: nothing is left"),
    ]


def test_the_figures_of_performance_are_those_of_the_evidence() -> None:
    assert performance.PAGE.read_text(encoding="utf-8") == performance.page(), "run `make docs`"


def test_a_figure_that_is_not_on_its_page_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(performance, "CHAPTERS", {"A": (performance.Quote("flight", "no such figure", "what"),)})
    with pytest.raises(KeyError, match="no such figure"):
        performance.page()


def test_every_statement_of_the_paper_has_a_place_and_something_that_shows_it() -> None:
    assert len(ROWS) > 40
    for statement, places, shown in ROWS:
        assert statement
        modules = re.findall(r"`(gloc3[\w.]*)`", places)
        assert modules, statement
        assert [one for one in modules if find_spec(one) is None] == [], statement
        tests = re.findall(r"`(tests/[\w/.]+)`", shown)
        assert [one for one in tests if not (ROOT / one).is_file()] == [], statement
        assert tests or "](" in shown, statement


def test_every_section_figure_and_table_of_the_paper_is_there() -> None:
    words = ("Section III-A", "Section III-B", "Section IV", "Section V:", "Section VI", "Section II ")
    figures = ("Fig. 1(a)", "Fig. 1(b)", "Fig. 1(c)", "Fig. 2", "Fig. 3", "Fig. 4", "Fig. 5", "Fig. 6")
    assert [one for one in (*words, *figures, "Table I:", "Table II") if one not in PAPER] == []


def test_the_tests_that_a_page_names_as_proof_exist() -> None:
    text = deaths.PAGE.read_text(encoding="utf-8")
    assert [one for one in re.findall(r"`(tests/[\w/.]+)`", text) if not (ROOT / one).is_file()] == []


def test_every_hazard_of_the_safety_case_has_a_measure_and_a_test() -> None:
    text = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    hazards = text.partition("| hazard | measure | test | evidence |")[2].partition("\n\n")[0].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in hazards]
    assert len(rows) > 12
    assert [row[0] for row in rows if len(row) < 3 or not row[1] or "`tests/" not in row[2]] == []
    named = [one for row in rows for one in re.findall(r"`(tests/[\w/.]+)`", row[2])]
    assert [one for one in named if not (ROOT / one).exists()] == []
    assert {"## Limits of use", "## Before the flight", "## In an emergency"} <= set(text.splitlines())


def test_the_comparison_names_each_of_the_usual_systems() -> None:
    text = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
    names = ["MAVROS", "px4_ros2", "Aerostack2", "MRS", "MAVSDK", "BlueOS", "MOOS-IvP", "QGroundControl", "MAVProxy"]
    assert [one for one in names if f"| {one}" not in text and f"with {one}" not in text] == []
    assert text.count("*Better there:*") == text.count("*Better here:*") == 7


def test_units_and_frames_are_those_of_the_code() -> None:
    text = (ROOT / "docs" / "time-frames-units.md").read_text(encoding="utf-8")
    assert dict(re.findall(r"^\| `(_\w+)` \| (.+?) \|$", text, re.MULTILINE)) == dict(UNITS)
    table = re.findall(r"^\| (\w+) \| (.+?) \| (.+?) \|$", frames.__doc__ or "", re.MULTILINE)
    assert len(table) > 4
    assert [row for row in table if f"| {' | '.join(row)} |" not in text] == []
