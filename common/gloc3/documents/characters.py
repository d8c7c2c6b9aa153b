"""Characters that steer a terminal or reverse the text around them, in names and texts that others have written."""

from typing import Final
from unicodedata import bidirectional, category

HARMLESS: Final = "\N{REPLACEMENT CHARACTER}"
_CONTROL_CATEGORIES: Final = ("Cc", "Zl", "Zp")
_DIRECTION_CLASSES: Final = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
"""Bidirectional classes of Unicode (UAX 9) that change the order of the text around them."""
_DIRECTION_MARKS: Final = ("\N{LEFT-TO-RIGHT MARK}", "\N{RIGHT-TO-LEFT MARK}", "\N{ARABIC LETTER MARK}")


def steers(letter: str) -> bool:
    """Whether a character steers a terminal, or changes the order of the characters around it."""
    return (
        category(letter) in _CONTROL_CATEGORIES
        or bidirectional(letter) in _DIRECTION_CLASSES
        or letter in _DIRECTION_MARKS
    )


def first_steering(text: str) -> str:
    """The first character that steers; empty where there is none."""
    return "" if text.isprintable() else next(filter(steers, text), "")


def harmless(text: str) -> str:
    """The text on one line: white space as spaces, and a replacement character for each one that steers."""
    if text.isprintable():
        return text
    return "".join(HARMLESS if steers(letter) else letter for letter in " ".join(text.split()))


def printable(text: str) -> str:
    """The text with its lines and spaces, and a replacement character for each one that steers."""
    if text.isprintable():
        return text
    return "".join(HARMLESS if letter != "\n" and steers(letter) else letter for letter in text.replace("\t", "    "))
