"""Keeps the developer's own configuration out of the tests."""

from itertools import count

import pytest

_numbers = count()


@pytest.fixture(autouse=True)
def _own_configuration(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder for it that each test makes where it writes any: to make it is most of what a quick test takes."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.getbasetemp() / f"configuration_{next(_numbers)}"))
    monkeypatch.delenv("NO_COLOR", raising=False)
