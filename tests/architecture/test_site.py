"""The site: every page has a place in it, no link of it is dead, and it fetches nothing from elsewhere."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

import pytest
from tests.house.site import TOP, site_link

ROOT = Path(__file__).parents[2]
FETCHED = re.compile(
    r"<(?:script|img|iframe)[^>]*\ssrc=\"https?:|<link[^>]*\srel=\"(?:stylesheet|preconnect|preload)\"[^>]*https?:"
)

built_here = pytest.mark.skipif(find_spec("mkdocs") is None, reason="older than requirements.txt: run make check")


def in_navigation() -> list[str]:
    """The pages that the navigation names, in its order."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    return re.findall(r": ([\w/-]+\.md)$", text, re.MULTILINE)


def build(config: Path, to: Path) -> subprocess.CompletedProcess[str]:
    called = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(config), "-d", str(to)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(called, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def test_every_page_is_in_the_navigation_once() -> None:
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    pages |= {f"tutorials/{path.name}" for path in (ROOT / "docs" / "tutorials").glob("*.md")}
    pages |= {f"reference/{path.name}" for path in (ROOT / "docs" / "reference").glob("*.md")}
    top = {place for place in TOP.values() if place.endswith(".md")}
    assert sorted(in_navigation()) == sorted({*pages, *top, "evidence/README.md"})
    assert in_navigation()[-1] == "evidence/README.md", "an appendix, behind all that is to be read"
    assert {path.name for path in ROOT.glob("*.md")} == {name for name in TOP if name.endswith(".md")}


def test_links_between_the_top_and_the_docs_are_the_same_in_the_site() -> None:
    assert site_link("docs/missions.md", PurePosixPath()) == "missions.md"
    assert site_link("../README.md", PurePosixPath("docs")) == "index.md"
    assert site_link("../security.md", PurePosixPath("docs/evidence")) == "../security.md"
    assert site_link("../../NOTICE", PurePosixPath("docs/evidence")) == "../NOTICE.txt"
    assert site_link("https://a.b/c", PurePosixPath("docs")) == "https://a.b/c"


@built_here
@pytest.mark.thorough
def test_the_site_is_built_without_a_warning_and_fetches_nothing(tmp_path: Path) -> None:
    built = build(ROOT / "mkdocs.yml", tmp_path)
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    pages = sorted(tmp_path.rglob("*.html"))
    assert len(pages) > 90
    assert [page.name for page in pages if FETCHED.search(page.read_text(encoding="utf-8"))] == []


@built_here
@pytest.mark.thorough
@pytest.mark.parametrize("link", ["gone.md", "index.md#gone"])
def test_a_dead_link_or_anchor_would_stop_it(link: str, tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/index.md").write_text(f"# Page\n\n[link]({link})\n")
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[0]
    (tmp_path / "mkdocs.yml").write_text(re.sub(r"^hooks:.*\n", "", text, flags=re.MULTILINE))
    built = build(tmp_path / "mkdocs.yml", tmp_path / "site")
    assert built.returncode != 0
    assert "gone" in built.stdout + built.stderr
