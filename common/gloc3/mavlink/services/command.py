"""Results of commands, in numbers and words; `command_client` sends commands, `command_server` receives them.

An accepted command is valid and will be tried; it need not be done yet. In progress prolongs the waiting. One command
of a kind runs at a time. What is lost is asked again, and what is asked again is not run again.
"""

from enum import IntEnum
from typing import Final


class CommandResult(IntEnum):
    """Results of a command: MAV_RESULT, and two ends that have no message."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    LONG_ONLY = 7
    INT_ONLY = 8
    UNSUPPORTED_FRAME = 9
    NOT_IN_CONTROL = 10
    OTHER = 254
    """A result that this version does not define."""
    NO_ANSWER = 255
    """Nobody answered, or the answer stayed away after it was in progress."""

    @property
    def words(self) -> str:
        """For a person."""
        return _WORDS[self]


_WORDS: Final = {
    CommandResult.ACCEPTED: "accepted",
    CommandResult.TEMPORARILY_REJECTED: "rejected for now; it may be accepted later",
    CommandResult.DENIED: "denied: it cannot be done with these values or in this state",
    CommandResult.UNSUPPORTED: "not supported",
    CommandResult.FAILED: "failed",
    CommandResult.IN_PROGRESS: "in progress",
    CommandResult.CANCELLED: "cancelled",
    CommandResult.LONG_ONLY: "must be sent as COMMAND_LONG",
    CommandResult.INT_ONLY: "must be sent as COMMAND_INT",
    CommandResult.UNSUPPORTED_FRAME: "this frame of reference is not supported",
    CommandResult.NOT_IN_CONTROL: "refused: the sender is not in control",
    CommandResult.OTHER: "answered with an unknown result",
    CommandResult.NO_ANSWER: "not answered",
}
