"""Characters that steer a terminal, in texts that others have written."""

import pytest

from gloc3.documents.characters import first_steering, harmless, printable

STEERING = ("\x1b", "\x07", "\r", "\x9b", "\u202e", "\u2066", "\u200f", "\u2028", "\u0085")


@pytest.mark.parametrize("letter", STEERING)
def test_what_steers_is_found_and_replaced(letter: str) -> None:
    assert first_steering(f"a{letter}b") == letter
    assert printable(f"a{letter}[2J  b") == "a\ufffd[2J  b"
    assert letter not in harmless(f"a{letter}b")


def test_lines_and_spaces_of_a_text_stay_and_names_become_one_line() -> None:
    assert printable("  é 中\n\tb\n") == "  é 中\n    b\n"
    assert harmless(" a\n\tb ") == "a b"
    assert first_steering("é 中\N{NO-BREAK SPACE}°") == ""
