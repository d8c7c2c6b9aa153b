"""The exceptions of GLOC3: misuse, refusals and input errors with their position."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Final

import msgspec

UNREADABLE: Final = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
"""What msgspec raises on bytes that are damaged, of another type, or nested without end."""
LISTED_MAX: Final = 16
"""Known words that a hint lists when none is near."""
LEAST_BEGINNING: Final = 3
"""So many letters of a word are enough where they begin only one that is known."""


class Gloc3Error(Exception):
    """Base of every error that this project raises on purpose."""


class Misuse(Gloc3Error):
    """Our own code, or an author's component, broke a rule of the architecture."""


class Refused(Gloc3Error):
    """A request that is turned down; the text is the reason, fit to be read by its sender."""


class Finding(msgspec.Struct, frozen=True, kw_only=True, order=True):
    """One thing that is wrong (or doubtful) in an input file, with its place."""

    file: str
    line: int = 0
    """Line, from 1; 0 where the whole file is meant."""
    column: int = 0
    """Column, from 1."""
    message: str
    hint: str = ""
    """What a person can do about it."""
    is_warning: bool = False
    """True where the input can still be used."""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        kind = "warning: " if self.is_warning else ""
        return f"{place}: {kind}{self.message}" + (f" ({self.hint})" if self.hint else "")


class InputError(Gloc3Error):
    """A file or a setting that cannot be used, with everything that is wrong in it."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        super().__init__("\n".join(str(finding) for finding in findings))
        self.findings = tuple(findings)


class NotFound(InputError):
    """A requested file or name does not exist, or cannot be read."""


class NoContact(Gloc3Error):
    """Nobody answers whom a command speaks to: the command is right, and fails."""


def nearest(name: str, known: Sequence[str], also: Sequence[str] = ()) -> str:
    """A hint with the known word nearest to `name`, or a list of the known words; words in `also` are not listed."""
    words = [*known, *also]
    begun = [word for word in words if len(name) >= LEAST_BEGINNING and word.startswith(name)]
    close = begun if len(begun) == 1 else get_close_matches(name, words, n=1, cutoff=0.65)
    if close:
        return f"did you mean {close[0]!r}?"
    if not known:
        return "none is known"
    names = sorted(known)
    return (
        "known: "
        + ", ".join(names[:LISTED_MAX])
        + (f" and {len(names) - LISTED_MAX} more" if names[LISTED_MAX:] else "")
    )
