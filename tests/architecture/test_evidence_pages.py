"""The pages of evidence have the titles and claims that their programs give them and cite commits of this history, and the
list of them is today's."""

import re
import shutil
import subprocess

import pytest
from tests.evidence.__main__ import BARS
from tests.evidence.page import INDEX, PAGES, ROOT, Bar, index

pytestmark = pytest.mark.thorough

COMMIT = re.compile(r"^- commit: `([0-9a-f]{7,40})`$", re.MULTILINE)
WRITTEN = [bar for bar in BARS if (PAGES / f"{bar.name}.md").exists()]


@pytest.mark.parametrize("bar", WRITTEN, ids=lambda bar: bar.name)
def test_a_page_has_the_title_and_claim_of_its_program(bar: Bar) -> None:
    page = PAGES / f"{bar.name}.md"
    assert page.read_text(encoding="utf-8").split("\n")[:3] == [f"# {bar.title}", "", bar.claim], "run make docs"


def test_each_page_belongs_to_a_program_and_claims_something_of_its_own() -> None:
    assert {page.stem for page in PAGES.glob("*.md")} - {INDEX.stem} == {bar.name for bar in WRITTEN}
    assert len({bar.title for bar in BARS}) == len(BARS)


def test_a_page_cites_a_commit_of_this_history() -> None:
    """One that anybody can check out, of the tree as it was committed."""
    history = _git("rev-list", "HEAD").split()
    if len(history) < 2 or _git("rev-parse", "--is-shallow-repository").strip() != "false":
        pytest.skip("this checkout has no history")
    texts = {bar.name: (PAGES / f"{bar.name}.md").read_text(encoding="utf-8") for bar in WRITTEN}
    cited = {name: COMMIT.findall(text) for name, text in texts.items()}
    assert {name: at for name, at in cited.items() if not any(full.startswith(tuple(at)) for full in history)} == {}


def _git(*arguments: str) -> str:
    if shutil.which("git") is None:
        return ""
    return subprocess.run(["git", *arguments], cwd=ROOT, check=False, capture_output=True, text=True).stdout


def test_the_list_names_every_page_with_its_result() -> None:
    assert INDEX.read_text(encoding="utf-8") == index(), "run make docs"
