"""The tutorials, done to the letter, each in a fresh environment."""

import fcntl
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.commands.foxglove_layout import check_layout
from tests.commands.fresh import fresh_environment, unpacked_wheel
from tests.tutorials import PAGES, Reader, do, run

pytestmark = [pytest.mark.flight, pytest.mark.sockets]


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """One for all processes of a run of the tests."""
    base = factory.getbasetemp()
    return base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base


@pytest.fixture
def reader(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Reader:
    """One in an empty folder, with GLOC3 from its wheel and an environment of their own."""
    site = unpacked_wheel(shared_folder(tmp_path_factory))
    environment = fresh_environment(tmp_path / "venv", site)
    folder = tmp_path / "home"
    folder.mkdir()
    found = Reader(folder, {**environment, "XDG_CONFIG_HOME": str(folder), "COLUMNS": "120"})
    assert run("python -c 'import gloc3; print(gloc3.__file__)'", found).startswith(str(site))
    return found


@pytest.fixture
def ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The usual ports, which readers use: one tutorial at a time, whichever process of the tests does it."""
    with (shared_folder(tmp_path_factory) / "tutorial.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.mark.usefixtures("ports")
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
