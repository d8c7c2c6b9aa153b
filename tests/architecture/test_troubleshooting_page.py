"""The page of messages and remedies is that of the source, and finds them in each of their forms."""

import ast

import pytest
from tests.house.troubleshooting import PAGE, Remedy, page, remedies

pytestmark = pytest.mark.thorough

SOURCE = """
def check(document, place, size):
    if size > 3:
        message, hint = "", ""
        message = f"{size} is too large"
        hint = "make it smaller"
    else:
        message = "it is too small"
        hint = "make it larger"
    yield document.finding(place, message, hint)
    yield Finding(file="a", message="no file", hint=f"write {size}")
    yield Check(GROUP, "disk", bad, f"{size} GB free", "move old logs elsewhere")
    yield Check(GROUP, "disk", bad, f"{size}", advice)
    yield document.finding(place, "nothing can be done")
"""


def test_messages_with_their_remedies_are_found_in_every_form() -> None:
    assert set(remedies(ast.walk(ast.parse(SOURCE)))) == {
        Remedy("… is too large", "make it smaller"),
        Remedy("it is too small", "make it larger"),
        Remedy("no file", "write …"),
        Remedy("disk: … GB free", "move old logs elsewhere"),
    }


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "make docs"
