"""Edits of YAML in place: the values are as asked for, and everything else of the text stays as it was."""

import pytest

from gloc3.documents.document import Where, parse
from gloc3.documents.document_edit import replaced, with_item, with_key, without_item
from gloc3.errors import Refused

TEXT = """\
# a mission – with a dash beyond ASCII
mission: ü  # its name
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 2}}  # up first
      way:   # then along
        follow_waypoints:
          waypoints_m:
            - [1, 2, 3]   # first
            - [4, 5, 6]   # second
          speed_m_s: 1
        after: [up]

      # down at the end
      down: {land: {}, after: [way]}"""
LIST: Where = ("tasks", "fly", "actions", "way", "follow_waypoints", "waypoints_m")
ACTIONS: Where = ("tasks", "fly", "actions")


def value_at(text: str, where: Where) -> object:
    value = parse(text, "t").value
    for step in where:
        value = value[step]
    return value


def changed_lines(text: str) -> tuple[list[str], list[str]]:
    """The lines that are gone, and those that are new."""
    before, after = TEXT.splitlines(), text.splitlines()
    return [line for line in before if line not in after], [line for line in after if line not in before]


def test_a_number_is_replaced_and_its_line_keeps_its_comment() -> None:
    found = replaced(TEXT, (*LIST, 1, 0), "9.5")
    assert changed_lines(found) == (["            - [4, 5, 6]   # second"], ["            - [9.5, 5, 6]   # second"])


@pytest.mark.parametrize("index", [0, 1, 2])
def test_an_entry_is_added_to_a_list_in_lines(index: int) -> None:
    found = with_item(TEXT, LIST, index, "[0, 0, 0]")
    assert changed_lines(found) == ([], ["            - [0, 0, 0]"])
    expected = [[1, 2, 3], [4, 5, 6]]
    expected.insert(index, [0, 0, 0])
    assert value_at(found, LIST) == expected


@pytest.mark.parametrize("text", ["a: [[1, 2], [3, 4]] # x", "a: [\n  [1, 2], # one\n  [3, 4],  # two\n] # x\n"])
@pytest.mark.parametrize("index", [0, 1, 2])
def test_an_entry_is_added_to_and_taken_out_of_a_list_in_brackets(text: str, index: int) -> None:
    found = with_item(text, ("a",), index, "[0, 0]")
    expected = [[1, 2], [3, 4]]
    expected.insert(index, [0, 0])
    assert value_at(found, ("a",)) == expected
    assert value_at(without_item(found, ("a",), index), ("a",)) == [[1, 2], [3, 4]]
    assert found.count("#") == text.count("#")


def test_an_entry_is_taken_out_with_its_line() -> None:
    found = without_item(TEXT, LIST, 0)
    assert changed_lines(found) == (["            - [1, 2, 3]   # first"], [])
    assert value_at(found, LIST) == [[4, 5, 6]]


def test_a_key_is_added_after_another_before_another_and_at_the_end() -> None:
    found = with_key(TEXT, ACTIONS, "more", "{hold: {}}", after="way")
    assert list(value_at(found, ACTIONS)) == ["up", "way", "more", "down"]  # type: ignore[call-overload]
    assert changed_lines(found) == ([], ["      more: {hold: {}}"])
    found = with_key(TEXT, (), "geofence", "{ceiling_m: 3}", before="tasks")
    assert changed_lines(found) == ([], ["geofence: {ceiling_m: 3}"])
    found = with_key(TEXT, ACTIONS, "more", "{hold: {}}")
    assert list(value_at(found, ACTIONS)) == ["up", "way", "down", "more"]  # type: ignore[call-overload]
    found = with_key(TEXT, (*ACTIONS, "down"), "retries", "1")
    assert found.endswith("      down: {land: {}, after: [way], retries: 1}")


@pytest.mark.parametrize(
    "edit",
    [
        lambda: replaced(TEXT, (*LIST, 7), "1"),
        lambda: replaced(TEXT, ("nothing",), "1"),
        lambda: replaced("a: [", ("a",), "1"),
        lambda: with_item(TEXT, ACTIONS, 0, "1"),
        lambda: with_item(TEXT, LIST, 3, "1"),
        lambda: without_item(TEXT, LIST, 2),
        lambda: with_key(TEXT, LIST, "x", "1"),
        lambda: with_key(TEXT, (), "tasks", "1"),
        lambda: with_item("a:\n- - 1\n  - 2\n", ("a", 0), 1, "3"),
    ],
)
def test_what_cannot_be_edited_is_refused(edit: object) -> None:
    with pytest.raises(Refused):
        edit()  # type: ignore[operator]


def test_windows_line_ends_stay() -> None:
    text = TEXT.replace("\n", "\r\n")
    found = replaced(text, (*LIST, 0, 2), "7")
    assert found == text.replace("[1, 2, 3]", "[1, 2, 7]")
