"""The page of symptoms quotes messages and remedies that GLOC3 really gives, and each of its rows has all three parts."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "symptoms.md").read_text(encoding="utf-8")
MADE = "".join((DOCS / page).read_text(encoding="utf-8") for page in ("troubleshooting.md", "reference/events.md"))
"""The pages that are made from all messages, remedies and events of the source."""


def is_said(quoted: str) -> bool:
    """Whether a row of the source's messages has a quoted text, where `…` is anything."""
    pattern = r"[^|\n]*".join(re.escape(part) for part in re.split(r" ?… ?", quoted))
    return re.search(pattern, MADE.replace("\\", "")) is not None


def test_what_is_quoted_is_really_said() -> None:
    quoted = re.findall(r"“(.+?)”", PAGE)
    assert len(quoted) > 30
    assert [one for one in quoted if not is_said(one)] == []


def test_a_message_that_is_gone_would_be_found() -> None:
    assert is_said("… is … m outside the fence")
    assert not is_said("… is … m beside the fence")
    assert not is_said("the vehicle is unwell")


def test_every_symptom_has_causes_each_with_a_message_and_a_remedy() -> None:
    chapters = re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]
    assert len(chapters) >= 10
    for chapter in chapters:
        rows = [line.strip("| ").split(" | ") for line in chapter.splitlines() if line.startswith("|")]
        assert rows[0] == ["cause", "it says", "do"], chapter
        assert len(rows) > 3
        assert all(len(row) == 3 and all(cell.strip() for cell in row) for row in rows), chapter
