"""Public Python names exist, are all that the docs and examples import, and keep their signatures."""

import re
from importlib import import_module
from pathlib import Path

import pytest
from tests.house.public_api import MESSAGES, PAGE, PUBLIC, page

from gloc3_groundstation import api

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/examples").rglob("*.py"))]
IMPORT = re.compile(r"^from (gloc3[\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)
GROUP = re.compile(r"\"(gloc3\.[a-z_]+)\"")


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_can_be_imported(name: str) -> None:
    module = import_module(name)
    assert [each for each in PUBLIC[name] if not hasattr(module, each)] == []


def test_the_station_for_scripts_is_public_whole() -> None:
    assert set(PUBLIC["gloc3_groundstation.api"]) == set(api.__all__)


def test_docs_and_examples_import_only_public_names() -> None:
    imported = [
        (path.name, module, name)
        for path in PAGES
        for module, names in IMPORT.findall(path.read_text(encoding="utf-8"))
        for name in re.findall(r"\w+", re.sub(r"\bas \w+|#.*", "", names))
        if not module.startswith(MESSAGES)
    ]
    assert len(imported) > 20
    assert [one for one in imported if one[2] not in PUBLIC.get(one[1], ())] == []


def test_signatures_are_those_of_the_page() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "is the change meant? docs/stability.md; then run `make docs`"


def test_every_group_of_entry_points_is_public_or_internal() -> None:
    used = {
        group
        for folder in ("common", "onboard", "groundstation", "sitl")
        for path in (ROOT / folder).rglob("*.py")
        for group in GROUP.findall(path.read_text(encoding="utf-8"))
    }
    text = (ROOT / "docs/stability.md").read_text(encoding="utf-8").partition("### Entry points")[2].partition("## ")[0]
    assert used == set(re.findall(r"`(gloc3\.[a-z_]+)`", text))
