"""The state table: every cell under a real host, the drawing in the documents, and mutants of both."""

import pytest
from tests.common.component import table_mutants, table_scenarios

from gloc3.component.lci import TABLE, Command, State, to_mermaid

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize(("state", "command"), table_scenarios.CELLS)
def test_a_cell_does_under_the_host_what_a_person_expects(state: str, command: str) -> None:
    assert table_scenarios.run(state, command) == table_scenarios.expected(state, command)


def test_the_scenarios_cover_every_cell() -> None:
    assert set(table_scenarios.CELLS) == {(str(state), str(command)) for state in State for command in Command}
    assert set(table_scenarios.ACCEPTED) == {(str(s), str(c)) for s, cells in TABLE.items() for c in cells}


def test_the_drawing_in_the_documents_is_the_table() -> None:
    assert to_mermaid() == table_mutants.drawing()


def test_every_single_cell_mutant_is_caught_by_the_scenarios_and_by_the_drawing() -> None:
    score = table_mutants.score()
    assert score.mutants > 400
    assert score.by_scenarios == score.by_drawing == score.mutants, score
    assert score.survivors == []
