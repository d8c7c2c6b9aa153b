"""Topics as rows: patterns, liveness, other packages' rows."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import Misuse
from gloc3.messages.envelope import ComponentStatus, Event, Message
from gloc3.messages.topics import TopicRow, TopicTable, matches


class Reading(Message, frozen=True):
    """A number from a device."""

    value: float


@pytest.mark.parametrize(
    ("pattern", "topic", "fits"),
    [
        ("p/pose", "p/pose", True),
        ("p/pose", "p/pose/raw", False),
        ("p/*", "p/pose", True),
        ("p/*", "p/pose/raw", False),
        ("*/components/*/status", "p/components/pose/status", True),
        ("p/**", "p/a/b/c", True),
        ("p/**", "p", True),
        ("p/**", "pp/a", False),
        ("**", "anything/at/all", True),
        ("*/components/**", "p/components/pose/status", True),
        ("*/components/**", "p/ci/request", False),
        ("p/cam*", "p/camera", True),
    ],
)
def test_a_star_is_one_level_and_two_at_the_end_any_number(pattern: str, topic: str, fits: bool) -> None:
    assert matches(pattern, topic) is fits


LEVELS = st.lists(st.text("abc_0", min_size=1, max_size=4), min_size=1, max_size=5)


@settings(max_examples=60)
@given(LEVELS, st.integers(0, 4), st.integers(0, 4))
def test_a_topic_with_levels_replaced_by_stars_fits_it(levels: list[str], star: int, cut: int) -> None:
    topic = "/".join(levels)
    assert matches(topic, topic)
    starred = [*levels]
    starred[star % len(levels)] = "*"
    assert matches("/".join(starred), topic)
    assert matches("/".join([*levels[: cut % len(levels)], "**"]), topic)
    assert not matches("/".join([*levels, "*"]), topic)


def test_a_topic_is_silent_after_so_many_nominal_periods() -> None:
    assert TopicRow(Reading, 10.0).is_alive(0.99)
    assert not TopicRow(Reading, 10.0).is_alive(1.0)
    assert not TopicRow(Reading, 20.0, silent_after=3.0).is_alive(0.15)
    assert TopicRow(Reading).is_alive(1e9)


def test_an_exact_name_goes_before_a_pattern_and_the_generic_rows_are_always_there() -> None:
    exact, pattern = TopicRow(Reading, 1.0), TopicRow(Reading, 2.0)
    table = TopicTable({"camera/*": pattern, "camera/front": exact})
    assert table.row("p/camera/front") is exact
    assert table.row("p/camera/left") is pattern
    assert table.row("p/camera") is None
    status = table.row("p/components/pose/status")
    assert status is not None
    assert status.message is ComponentStatus


def test_rows_that_come_later_are_found() -> None:
    table = TopicTable()
    assert table.row("p/level") is None
    table.add({"level": TopicRow(Reading)})
    assert table.row("p/level") is not None
    assert Reading in list(table.types)


def test_two_packages_cannot_declare_one_topic() -> None:
    table = TopicTable({"level": TopicRow(Reading, 1.0)})
    with pytest.raises(Misuse, match="two packages declare the topic 'level'"):
        table.add({"level": TopicRow(Event)})


def test_the_rows_of_installed_packages_are_found() -> None:
    names = [name for name, _ in TopicTable.installed()]
    assert {"pose", "setpoint", "components/*/status"} <= set(names)
