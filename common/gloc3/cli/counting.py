"""Numbers and lists of things in words."""

from collections.abc import Sequence


def counted(count: int, what: str) -> str:
    """`1 log`, `2 logs`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def listed(words: Sequence[str], joint: str) -> str:
    """`a`, `a and b`, `a, b and c`, with the joint `and`."""
    *others, last = words
    return f"{', '.join(others)} {joint} {last}" if others else last
