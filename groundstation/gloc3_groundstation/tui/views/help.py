"""The help of a screen: what it is for, its keys, and those that work everywhere."""

from collections.abc import Sequence
from typing import NamedTuple

from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, wrapped


class HelpKey(NamedTuple):
    """A key with all that is said of it."""

    key: str
    label: str
    help: str
    is_general: bool
    """Whether it works on every screen."""


def help_lines(text: str, keys: Sequence[HelpKey], screens: Sequence[tuple[str, str, str]], width: int) -> list[Line]:
    """The help in lines.

    Args:
        text: what the screen says of itself.
        keys: those that work now.
        screens: key, title and a line for each screen.
        width: columns.
    """
    lines: list[Line] = []
    for paragraph in text.strip().split("\n\n"):
        lines += [(Span(row),) for row in wrapped(" ".join(paragraph.split()), width)]
        lines.append(EMPTY)
    for heading, is_general in (("Keys of this screen", False), ("Keys that work everywhere", True)):
        listed = [key for key in keys if key.is_general is is_general]
        if listed:
            lines.append((Span(heading, Tone.STRONG),))
            for key in listed:
                said = f"{key.label}: {key.help}" if key.help else key.label
                lines += _entry(key.key, said, width)
            lines.append(EMPTY)
    lines.append((Span("Screens", Tone.STRONG),))
    for digit, title, said in screens:
        lines += _entry(digit, f"{title}: {said}", width)
    return lines


def _entry(key: str, text: str, width: int) -> list[Line]:
    rows = wrapped(text, width - 12)
    return [(Span(f"  {key if n == 0 else '':<10}", Tone.KEY), Span(row)) for n, row in enumerate(rows)]
