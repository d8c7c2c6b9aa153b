"""Numbers beside their limits in messages, with as many digits as it takes to tell them apart."""

from math import ceil
from typing import Final

MOST_DIGITS: Final = 9


def beside(value: float, limit: float, digits: int = 1) -> str:
    """A value that is compared with a limit: `30.04` beside 30, never `30.0`.

    Args:
        value: the value.
        limit: what the message compares it with.
        digits: the decimals that it has at least.
    """
    for more in range(digits, MOST_DIGITS):
        if value == limit or round(value, more) != round(limit, more):
            return f"{value:z.{more}f}"
    return f"{value:z.{MOST_DIGITS}f}"


def excess(by: float, digits: int = 1, *, is_enough: bool = False) -> str:
    """How far a value is beyond a limit, with two digits or more where it is small: `18.0`, `0.04`, never `0.0`.

    Args:
        by: how far, positive.
        digits: the decimals that it has at least.
        is_enough: rounded up, for advice by how much to change the value.
    """
    for more in range(digits, MOST_DIGITS):
        shown = ceil(by * 10**more - 1e-6) / 10**more if is_enough else round(by, more)
        if abs(shown - by) <= 0.1 * by:
            return f"{shown:.{more}f}"
    return f"{by:.{MOST_DIGITS}f}"
