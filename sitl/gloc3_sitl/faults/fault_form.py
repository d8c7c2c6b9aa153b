"""Text forms of the kinds of faults: a target, a word or a number, a size."""

import math
from collections.abc import Callable
from math import inf, nan
from typing import NamedTuple

import msgspec

from gloc3.errors import Refused

Ended = Callable[[], None]
"""Ends a fault's effect."""


class Parsed(NamedTuple):
    """The parts of a fault's text, without its times."""

    target: str
    word: str
    """The value, where it is a word."""
    number: float
    """The value, where it is a number."""
    size: float | None


class FaultForm(msgspec.Struct, frozen=True, kw_only=True):
    """Text form of one kind of fault."""

    text: str
    """For people."""
    does: str
    """In a line."""
    has_target: bool = False
    words: tuple[str, ...] = ()
    """What the value may be; empty where it is a number."""
    bounds: tuple[float, float] | None = None
    """Of the number; None where there is none."""
    default: float | None = None
    """Default of the number; None where it is required."""
    size_of: tuple[str, ...] = ()
    """The words that take a size; the number takes one where this holds an empty text."""
    takes_text: bool = False
    """The value may be any text, or missing."""
    is_event: bool = False
    """Whether it happens once, unless a span is given and it `may_last`."""
    may_last: bool = False
    lasts_s: float = inf
    """Duration if no end is given, s."""

    def read(self, target: str | None, value: str | None, size: str | None) -> Parsed:
        """Reads the parts of a fault's text.

        Raises:
            Refused: a part is missing, unknown or out of range.
        """
        if self.has_target != (target is not None):
            raise Refused("a name is missing after the colon" if self.has_target else f"{target!r} is not expected")
        word, number = "", 0.0
        if self.words:
            word = value or ""
            if word not in self.words:
                raise Refused(f"{word!r} is unknown; known: {', '.join(self.words)}")
        elif self.takes_text:
            word = value or ""
        elif self.bounds is not None:
            number = self._number(value)
        elif value is not None:
            raise Refused(f"={value} is not expected")
        if size is not None and word not in self.size_of:
            raise Refused(f"/{size} is not expected")
        sized = None if size is None else finite(size)
        if sized is not None and sized < 0.0 and word in ("late", "stale", "noisy"):
            raise Refused(f"/{size} is negative")
        return Parsed(target or "", word, number, sized)

    def _number(self, value: str | None) -> float:
        assert self.bounds is not None
        if value is None:
            if self.default is None:
                raise Refused("a number is missing")
            return self.default
        number, (low, high) = finite(value), self.bounds
        if not low <= number <= high:
            raise Refused(f"{number:g} is not within {low:g} to {high:g}")
        return number


def finite(text: str) -> float:
    """Reads a number.

    Raises:
        Refused: it is none, or no finite one.
    """
    try:
        number = float(text)
    except ValueError:
        number = nan
    if not math.isfinite(number):
        raise Refused(f"{text!r} is not a finite number")
    return number
