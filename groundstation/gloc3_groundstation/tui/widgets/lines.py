"""Lines of panels: spans, each with a tone. Made without Textual, so that tests read them as text."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Final, NamedTuple


class Tone(StrEnum):
    """Meaning of a span; the theme gives it a colour. No tone is needed to read a line: the words say it too."""

    __hash__ = str.__hash__  # the enum's own is written in Python, and lines are looked up by their spans all the time

    TEXT = "text"
    DIM = "dim"
    STRONG = "strong"
    GOOD = "good"
    BUSY = "busy"
    """Something is in progress."""
    WARN = "warn"
    BAD = "bad"
    ALARM = "alarm"
    STALE = "stale"
    """No longer current."""
    KEY = "key"
    """A key to press."""
    CHOSEN = "chosen"
    """Where the operator is: the screen that is shown."""
    FIRST = "first"
    """The first of several distinguished things, such as vehicles on a map, whose names are shown beside them."""
    SECOND = "second"
    THIRD = "third"
    FOURTH = "fourth"
    FIFTH = "fifth"
    SIXTH = "sixth"
    GROUND = "ground"
    """Below the horizon."""


class Span(NamedTuple):
    """Some text in one tone."""

    text: str
    tone: Tone = Tone.TEXT


ONE_OF_MANY: Final = (Tone.FIRST, Tone.SECOND, Tone.THIRD, Tone.FOURTH, Tone.FIFTH, Tone.SIXTH)
"""Tones of distinguished things, in turn."""

Line = tuple[Span, ...]

EMPTY: Final[Line] = ()


def text_of(line: Line) -> str:
    """A line without its tones."""
    return "".join(span.text for span in line)


def faded(line: Line) -> Line:
    """The same line, shown as stale."""
    return tuple(Span(span.text, Tone.STALE) for span in line)


def spread(left: Line, right: Line, width: int) -> Line:
    """Two parts at both ends of a line; the right one goes when there is no room."""
    gap = width - len(text_of(left)) - len(text_of(right))
    return (*left, Span(" " * gap), *right) if gap >= 2 else left


def joined(parts: list[Span], gap: str = "   ") -> Line:
    """Spans with a gap between them."""
    found: list[Span] = []
    for part in parts:
        if found:
            found.append(Span(gap))
        found.append(part)
    return tuple(found)


def bar(share: float, width: int) -> str:
    """A bar of `width` characters, filled to `share` of it."""
    filled = round(max(0.0, min(1.0, share)) * width)
    return "━" * filled + "╌" * (width - filled)


def wrapped(text: str, width: int) -> list[str]:
    """Text in lines of at most `width` characters, broken at spaces where possible."""
    lines: list[str] = []
    for paragraph in text.splitlines() or [""]:
        rest = paragraph
        while len(rest) > width > 0:
            cut = rest.rfind(" ", 1, width + 1)
            cut = cut if cut > 0 else width
            lines.append(rest[:cut].rstrip())
            rest = rest[cut:].lstrip()
        lines.append(rest)
    return lines


def cut(text: str, width: int) -> str:
    """Text in at most `width` characters; an ellipsis replaces the rest."""
    if len(text) <= width:
        return text
    return text[: width - 1] + "…" if width > 0 else ""


def column(text: str, width: int) -> str:
    """Text in exactly `width` characters."""
    return f"{cut(text, width):<{width}}"


def fitted(parts: Sequence[tuple[int, Span]], width: int, gap: str = "   ") -> Line:
    """Those spans that have room side by side; those of the highest numbers go first."""
    kept = list(parts)
    while kept and len(text_of(joined([span for _, span in kept], gap))) > width:
        least = max(rank for rank, _ in kept)
        kept.pop(max(index for index, (rank, _) in enumerate(kept) if rank == least))
    return joined([span for _, span in kept], gap)


def changed_columns(before: Line, after: Line) -> tuple[int, int]:
    """The columns from the first to behind the last in which two lines differ; each character has one column."""
    previous = [(letter, span.tone) for span in before for letter in span.text]
    new = [(letter, span.tone) for span in after for letter in span.text]
    shortest, longest = sorted((len(previous), len(new)))
    begin = next((column for column in range(shortest) if previous[column] != new[column]), shortest)
    if len(previous) != len(new):
        return begin, longest
    end = next((column for column in range(longest, begin, -1) if previous[column - 1] != new[column - 1]), begin)
    return begin, end
