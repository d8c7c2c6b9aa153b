"""The tutorials, done to the letter, each in a fresh environment."""

import os
import re
from pathlib import Path

import pytest
from tests.commands.foxglove_layout import check_layout
from tests.commands.fresh import fresh_environment, unpacked_wheel
from tests.tutorials import PAGES, Reader, do, run

pytestmark = [pytest.mark.flight, pytest.mark.sockets]


@pytest.fixture
def reader(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Reader:
    """One in an empty folder, with GLOC3 from its wheel and an environment of their own."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
    site = unpacked_wheel(shared)
    environment = fresh_environment(tmp_path / "venv", site)
    folder = tmp_path / "home"
    folder.mkdir()
    found = Reader(folder, {**environment, "XDG_CONFIG_HOME": str(folder), "COLUMNS": "120"})
    assert run("python -c 'import gloc3; print(gloc3.__file__)'", found).startswith(str(site))
    return found


@pytest.mark.parametrize("page", sorted(path.stem for path in PAGES.glob("*.md")))
def test_a_tutorial_is_done_to_the_letter(page: str, reader: Reader) -> None:
    do(page, reader)
    if page == "foxglove":
        shown = check_layout(reader.folder / "filmed")
        assert set(shown) == {"ThreeDee", "Image", "Plot", "Log", "Map"}
        named = set(re.findall(r"`((?:frames|scene|filmed|calibration)[\w/]*)`", panels_of(page)))
        assert named == {"frames"}.union(*shown.values())


def panels_of(page: str) -> str:
    """The table of panels of a page, without those that are mentioned only."""
    (table,) = re.findall(
        r"^\| panel .*?\n\n", (PAGES / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    return str(table)
