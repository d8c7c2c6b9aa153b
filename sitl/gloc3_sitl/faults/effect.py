"""The form of an entry in the table of faults: text form, check, begin and end."""

from collections.abc import Callable
from typing import NamedTuple

from gloc3_sitl.faults.fault_form import Ended, FaultForm, Parsed
from gloc3_sitl.flight.flight import Flight


def fits(flight: Flight, given: Parsed) -> None:
    """For faults that fit every flight."""


class Effect(NamedTuple):
    """One kind of fault: its text form, its check and its effect."""

    form: FaultForm
    begin: Callable[[Flight, Parsed, bool], Ended]
    """Begins it; the flag says that it is a single event."""
    check: Callable[[Flight, Parsed], None] = fits
    """Raises `Refused` where it does not fit the flight."""


def nothing() -> None:
    """What happened once needs no end."""
