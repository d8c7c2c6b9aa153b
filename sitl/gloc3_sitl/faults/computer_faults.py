"""Faults of the onboard computer: its disk is full, its date is set."""

from collections.abc import Mapping
from typing import Final

from gloc3_sitl.faults.effect import Effect, nothing
from gloc3_sitl.faults.fault_form import Ended, FaultForm, Parsed
from gloc3_sitl.flight.flight import Flight


def _fill(flight: Flight, _: Parsed, __: bool) -> Ended:
    disk = flight.process.disk
    disk.is_full = True

    def clear() -> None:
        disk.is_full = False

    return clear


def _set_date(flight: Flight, given: Parsed, _: bool) -> Ended:
    flight.clock.set_by_s += given.number
    return nothing


COMPUTER: Final[Mapping[str, Effect]] = {
    "disk_full": Effect(
        FaultForm(text="disk_full", does="journal, progress and reports cannot be written to disk"), _fill
    ),
    "clock_jump": Effect(
        FaultForm(
            text="clock_jump=SECONDS",
            does="the computer's date is set this much later, or earlier",
            bounds=(-1e9, 1e9),
            is_event=True,
        ),
        _set_date,
    ),
}
"""Every kind of fault of the computer."""
