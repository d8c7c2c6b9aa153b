"""The error handler of a component (paper §IV-A): keeps track of its errors."""

import traceback
from typing import NamedTuple


class Cause(NamedTuple):
    """One kind of error that a component has had."""

    count: int
    first_s: float
    last_s: float


class ErrorHandler:
    """Counts errors by cause, with the first and last time; hands out each cause's traceback once."""

    def __init__(self) -> None:
        self.causes: dict[str, Cause] = {}
        self.total = 0
        self.last_cause = ""

    def record(self, cause: str, now_s: float, error: BaseException | None = None) -> str:
        """Notes an error; returns its traceback the first time that its cause is seen, else an empty text."""
        known = self.causes.get(cause)
        self.total += 1
        self.last_cause = cause
        self.causes[cause] = (
            Cause(1, now_s, now_s) if known is None else known._replace(count=known.count + 1, last_s=now_s)
        )
        if known is not None or error is None:
            return ""
        # Frames only, without the folder: a log does not depend on where the code is installed.
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f"{frame.filename.rpartition('/')[2]}:{frame.lineno} {frame.name}: {frame.line}" for frame in frames]
        return "\n".join([*lines, describe(error)])

    @property
    def last(self) -> Cause | None:
        """The last error's cause."""
        return self.causes.get(self.last_cause)


def describe(error: BaseException) -> str:
    """An exception in one line."""
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
