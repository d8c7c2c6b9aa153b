"""The error handler of a component (paper §IV-A): keeps track of its errors."""

import re
import traceback
from typing import Final, NamedTuple

from gloc3.component.workers import guard
from gloc3.errors import Gloc3Error, Misuse

CAUSES_MAX: Final = 64
"""Distinct causes kept; the least recently seen one is dropped."""
LINE_MAX: Final = 240

_ADDRESS: Final = re.compile(r" at 0x[0-9a-fA-F]+")


class ErrorCause(NamedTuple):
    """One kind of error that a component has had."""

    times: int
    first_s: float
    last_s: float


class CountedError(NamedTuple):
    """An error that is counted and reported, but does not make the component faulty."""

    during: str
    error: BaseException


class ErrorHandler:
    """Counts errors by cause, with the first and last time; hands out each cause's traceback once."""

    def __init__(self) -> None:
        self.causes: dict[str, ErrorCause] = {}
        """The newest last."""
        self.total = 0
        self.last_cause = ""

    def record(self, cause: str, now_s: float, error: BaseException | None = None, *, is_minor: bool = False) -> str:
        """Records an error; returns its traceback the first time that its cause occurs, else an empty text.

        Args:
            cause: one line.
            now_s: when it happened.
            error: the exception, if any.
            is_minor: whether the previous cause stays the displayed one.
        """
        known = self.causes.pop(cause, None)
        self.total += 1
        if not is_minor:
            self.last_cause = cause
        self.causes[cause] = (
            ErrorCause(1, now_s, now_s) if known is None else known._replace(times=known.times + 1, last_s=now_s)
        )
        if len(self.causes) > CAUSES_MAX:
            del self.causes[next(iter(self.causes))]
        return "" if known is not None or error is None else trace(error)

    @property
    def last(self) -> ErrorCause | None:
        """The last error's cause."""
        return self.causes.get(self.last_cause)


def trace(error: BaseException) -> str:
    """Traceback of an exception, without folders, so that a log does not depend on where the code is installed.

    Empty for an error whose message already explains a fault outside the program, such as a missing device.
    """
    if _speaks_for_itself(error):
        return ""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f"{frame.filename.rpartition('/')[2]}:{frame.lineno} {frame.name}: {frame.line}" for frame in frames]
    return "\n".join([*lines, describe(error)])


def describe(error: BaseException) -> str:
    """An exception in one line, the same in every run."""
    text, _ = guard(str, error)
    line = one_line(text or "")
    if line and _speaks_for_itself(error):
        return line
    return f"{type(error).__name__}: {line}" if line else type(error).__name__


def _speaks_for_itself(error: BaseException) -> bool:
    return isinstance(error, Gloc3Error) and not isinstance(error, Misuse)


def reason_of(refusal: BaseException | None) -> str:
    """The text of a refusal, whatever an author put into it; never empty."""
    text, _ = guard(str, refusal)
    return text or "refused"


def one_line(text: str) -> str:
    """Shortens an author's text to one line without memory addresses of objects."""
    return _ADDRESS.sub("", " ".join(text.split()))[:LINE_MAX]
