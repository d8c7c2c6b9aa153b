"""Outcomes of a run, each with its exit code."""

from enum import StrEnum
from typing import Final

from gloc3.errors import Finding, Gloc3Error, InputError, NoContact, Refused
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.station.command_client import CheckFailed


class RunOutcome(StrEnum):
    """What has become of a run."""

    DONE = "done"
    FAILED = "failed"
    """The mission failed or did not pass a check."""
    WRONG_USE = "wrong_use"
    TAKEN_OVER = "taken_over"
    """A pilot or the autopilot's failsafe has landed the vehicle."""
    REFUSED = "refused"
    """The vehicle, or the station in control of it, refused a request."""
    NOT_HEARD = "not_heard"
    """Nothing was received from the vehicle, or no answer."""
    INTERRUPTED = "interrupted"

    @property
    def exit_code(self) -> int:
        """Exit code of the program."""
        return _EXIT_CODES[self]


_EXIT_CODES: Final = {
    RunOutcome.DONE: 0,
    RunOutcome.FAILED: 1,
    RunOutcome.WRONG_USE: 2,
    RunOutcome.TAKEN_OVER: 3,
    RunOutcome.REFUSED: 4,
    RunOutcome.NOT_HEARD: 5,
    RunOutcome.INTERRUPTED: 130,
}


def outcome_of(end: End | Gloc3Error) -> RunOutcome:
    """Outcome of a run from the end of its mission, or from the error that has ended it."""
    match end:
        case End(by=""):
            return RunOutcome.DONE if end.is_done else RunOutcome.FAILED
        case End():
            return RunOutcome.TAKEN_OVER
        case NoContact():
            return RunOutcome.NOT_HEARD
        case CheckFailed():
            return RunOutcome.FAILED
        case Refused():
            return RunOutcome.REFUSED
        case _:
            return RunOutcome.FAILED


def findings_of(error: Gloc3Error) -> tuple[Finding, ...]:
    """What a check has found, here or on the vehicle; empty for other errors."""
    return error.findings if isinstance(error, InputError | CheckFailed) else ()
