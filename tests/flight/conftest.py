"""The flight fixture: a test card for a flight of the whole stack in virtual time, in a style of autopilot.

Each test is there in both styles. Where the style has no part in what is tested, which is nearly everywhere, an ordinary
run flies one of the two, always the same one; `--every-style` flies both.
"""

import zlib
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


def _other_style(item: pytest.Item) -> str:
    """The id of the same test in the other style; empty where there is nothing to choose."""
    callspec = getattr(item, "callspec", None)
    style = callspec.params.get("style") if callspec is not None else None
    if style not in STYLES or item.get_closest_marker("both_styles"):
        return ""
    name, _, parameters = item.nodeid.partition("[")
    words = parameters.removesuffix("]").split("-")
    words[words.index(style)] = STYLES[1 - STYLES.index(style)]
    return f"{name}[{'-'.join(words)}]"


def _is_chosen(item: pytest.Item, other: str) -> bool:
    """Whether of the two this is the one that an ordinary run flies: by its name alone, so that it stays the same."""
    first, second = sorted((item.nodeid, other))
    return item.nodeid == (first, second)[zlib.crc32(first.encode()) % 2]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Everything here flies, in one style where nobody asks for both; what is named with its style is left alone."""
    flights = [item for item in items if "/tests/flight/" in item.path.as_posix()]
    for item in flights:
        item.add_marker(pytest.mark.flight)
    if config.getoption("every_style") or any("[" in argument for argument in config.args):
        return
    others = {item: _other_style(item) for item in flights}
    ids = {item.nodeid for item in flights}
    left_out = {item for item, other in others.items() if other in ids and not _is_chosen(item, other)}
    config.hook.pytest_deselected(items=list(left_out))
    items[:] = [item for item in items if item not in left_out]
