"""The text of a fault as its parts, to shift it, shorten it and compare it."""

from math import inf
from typing import NamedTuple


class FaultText(NamedTuple):
    """A fault's text: what goes wrong, and when."""

    what: str
    begin_s: float
    end_s: float | None = None
    """None for what has no end in its text."""

    def __str__(self) -> str:
        if self.end_s is None:
            return f"{self.what}@{self.begin_s:g}"
        return f"{self.what}@{self.begin_s:g}.." + (f"{self.end_s:g}" if self.end_s < inf else "")

    @property
    def target(self) -> str:
        """What it is about, without value: two of one target at a time make no sense."""
        return self.what.partition("=")[0]

    def shifted(self, begin_s: float) -> "FaultText":
        """The same at another time."""
        begin_s = round(max(0.1, begin_s), 1)
        if self.end_s is None or self.end_s == inf:
            return self._replace(begin_s=begin_s)
        return self._replace(begin_s=begin_s, end_s=round(self.end_s + begin_s - self.begin_s, 1))


def parse(text: str) -> FaultText:
    """Reads a text that `str(FaultText)` has made, or a person."""
    what, _, span = text.partition("@")
    first, dots, last = span.partition("..")
    end_s = None if not dots else float(last) if last else inf
    return FaultText(what, float(first or 0.1), end_s)
