"""The pages of evidence have the titles and claims that their programs give them, and the list of them is today's."""

import pytest
from tests.evidence.__main__ import BARS
from tests.evidence.page import INDEX, PAGES, Bar, index

pytestmark = pytest.mark.thorough


WRITTEN = [bar for bar in BARS if (PAGES / f"{bar.name}.md").exists()]


@pytest.mark.parametrize("bar", WRITTEN, ids=lambda bar: bar.name)
def test_a_page_has_the_title_and_claim_of_its_program(bar: Bar) -> None:
    page = PAGES / f"{bar.name}.md"
    assert page.read_text(encoding="utf-8").split("\n")[:3] == [f"# {bar.title}", "", bar.claim], "run make docs"


def test_each_page_belongs_to_a_program_and_claims_something_of_its_own() -> None:
    assert {page.stem for page in PAGES.glob("*.md")} - {INDEX.stem} == {bar.name for bar in WRITTEN}
    assert len({bar.title for bar in BARS}) == len(BARS)


def test_the_list_names_every_page_with_its_result() -> None:
    assert INDEX.read_text(encoding="utf-8") == index(), "run make docs"
