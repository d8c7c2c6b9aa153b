"""Requests to the autopilot: their authors and results."""

from enum import StrEnum
from typing import Final, NamedTuple

from gloc3_sitl.autopilot.modes import Result


class Author(StrEnum):
    """Author of a request."""

    COMMAND = "command"
    PILOT = "pilot"
    FAILSAFE = "failsafe"
    SELF = "self"


class RequestVerdict(NamedTuple):
    """Result of a request, with the reason where it was refused."""

    result: Result
    reason: str = ""

    @property
    def is_accepted(self) -> bool:
        """Whether it is done, or will be."""
        return self.result is Result.ACCEPTED


ACCEPTED: Final = RequestVerdict(Result.ACCEPTED)
OUT_OF_RANGE: Final = RequestVerdict(Result.DENIED, "parameters out of range")
