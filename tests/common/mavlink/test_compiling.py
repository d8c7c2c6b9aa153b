"""The compiled loop of direct lines: where it is kept, and what is said where it cannot be."""

from pathlib import Path
from queue import SimpleQueue

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.compiling import Compiling, can_compile, kept_at

pytestmark = pytest.mark.skipif(not can_compile(), reason="numba is not installed, or this is not Linux")


def test_it_is_kept_in_the_users_folder_or_in_the_services(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CACHE_DIRECTORY", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert kept_at().parent == tmp_path / "gloc3"
    monkeypatch.setenv("CACHE_DIRECTORY", "/var/cache/gloc3/pelican")
    assert kept_at().parent == Path("/var/cache/gloc3/pelican")


def test_where_nothing_can_be_kept_that_is_told_and_nothing_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_folder = tmp_path / "file"
    no_folder.touch()
    monkeypatch.setenv("CACHE_DIRECTORY", str(no_folder))
    told, compiling = SimpleQueue[BaseException](), Compiling()
    compiling.begin(told.put)
    error = told.get(timeout=60.0)
    assert isinstance(error, Refused)
    assert str(error).endswith("Not a directory")
    assert compiling.loop is None
    compiling.begin(told.put)
    assert told.empty(), "it is tried once"
