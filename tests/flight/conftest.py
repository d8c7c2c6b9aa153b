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


def _other_style(item: pytest.Item) -> str | None:
    """The id of the same test in the other style; nothing where there is none to choose from."""
    callspec = getattr(item, "callspec", None)
    style = callspec.params.get("style") if callspec is not None else None
    if style not in STYLES or item.get_closest_marker("both_styles"):
        return None
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
    for item in items:
        if "/tests/flight/" in item.path.as_posix():
            item.add_marker(pytest.mark.flight)
    if config.getoption("every_style") or any("[" in argument for argument in config.args):
        return
    ids = {item.nodeid for item in items}
    kept, left_out = list[pytest.Item](), list[pytest.Item]()
    for item in items:
        other = _other_style(item)
        (kept if other is None or other not in ids or _is_chosen(item, other) else left_out).append(item)
    config.hook.pytest_deselected(items=left_out)
    items[:] = kept
