"""The reference pages are those of the code."""

from pathlib import Path

import pytest
from tests.house.reference import FOLDER, pages

PAGES = pages()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_a_reference_page_is_up_to_date(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == PAGES[path](), "run `make docs`"


def test_there_is_no_other_page() -> None:
    assert set(FOLDER.iterdir()) == set(PAGES)
