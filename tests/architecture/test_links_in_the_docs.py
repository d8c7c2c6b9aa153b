"""What the README and the docs point to is there, headings too; and their pictures fetch nothing from elsewhere."""

import re
from pathlib import Path

import pytest
from tests.house.site import anchor_of

ROOT = Path(__file__).parents[2]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"\]\(([^)#\s]*)(#[^)\s]*)?\)")


def anchors(page: Path) -> set[str]:
    """The names by which a page's headings are reached."""
    return set(map(anchor_of, re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for target, anchor in LINK.findall(text):
        if "://" in target:
            continue
        found = page.parent / target if target else page
        assert found.exists(), target
        assert not anchor or anchor[1:] in anchors(found), f"{target}{anchor}"


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name == "docs"], ids=lambda page: page.name)
def test_tests_that_are_named_exist(page: Path) -> None:
    named = re.findall(r"(?<![\w/])tests/\w+/[\w/]+\.py", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL))
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.parent.name != "evidence"], ids=lambda page: str(page.relative_to(ROOT))
)
def test_files_and_folders_of_the_repository_that_are_named_exist(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    named = re.findall(r"`((?:common|onboard|groundstation|sitl|docs)/[\w./*-]+)`", text)
    assert [name for name in named if not any(ROOT.glob(name))] == []


@pytest.mark.parametrize("picture", sorted((ROOT / "docs").rglob("*.svg")), ids=lambda picture: picture.name)
def test_pictures_are_whole_and_fetch_nothing(picture: Path) -> None:
    text = picture.read_text()
    assert text.rstrip().endswith("</svg>")
    assert not re.search(r"url\(['\"]?https?:|href=['\"]https?:", text)
