"""The flight fixture: a test card for a flight of the whole stack in virtual time, in each style of autopilot."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.flight.card import Card

STYLES = ("px4", "ardupilot")


@pytest.fixture(params=STYLES)
def style(request: pytest.FixtureRequest) -> str:
    """The style of autopilot that is flown."""
    return str(request.param)


@pytest.fixture
def flight(style: str, tmp_path: Path) -> Iterator[Card]:
    """A test card; the test begins the flight."""
    card = Card(style, tmp_path)
    yield card
    card.close()
    assert not card.failures, card.failures


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Everything here flies."""
    for item in items:
        if "/tests/flight/" in item.path.as_posix():
            item.add_marker(pytest.mark.flight)
