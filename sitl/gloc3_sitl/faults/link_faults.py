"""Faults of links: the station's radio and the autopilot's cable lose, delay and repeat what passes."""

from collections.abc import Callable, Mapping
from typing import Final

from gloc3.mavlink.transport.memory import MemoryLink
from gloc3_sitl.faults.effect import Effect
from gloc3_sitl.faults.fault_form import Ended, FaultForm, Parsed
from gloc3_sitl.flight.flight import Flight

_SHARE: Final = (0.0, 1.0)


def _radio(flight: Flight) -> MemoryLink:
    return flight.links.radio


def _cable(flight: Flight) -> MemoryLink:
    return flight.links.cable


def _impair(link: Callable[[Flight], MemoryLink], name: str) -> Callable[[Flight, Parsed, bool], Ended]:
    """Makes one of a link's conditions as bad as the fault's number says."""
    return lambda flight, given, _: flight.links.impair(link(flight), **{name: given.number})


LINKS: Final[Mapping[str, Effect]] = {
    "link_loss": Effect(
        FaultForm(
            text="link_loss[=SHARE]", does="the station's radio loses this share, or all", bounds=_SHARE, default=1.0
        ),
        _impair(_radio, "loss"),
    ),
    "cable_loss": Effect(
        FaultForm(text="cable_loss[=SHARE]", does="the autopilot's cable, too", bounds=_SHARE, default=1.0),
        _impair(_cable, "loss"),
    ),
    "link_slow": Effect(
        FaultForm(text="link_slow=SECONDS", does="what the station's radio carries is this late", bounds=(0.0, 60.0)),
        _impair(_radio, "latency_s"),
    ),
    "cable_slow": Effect(
        FaultForm(
            text="cable_slow=SECONDS", does="what the autopilot's cable carries is this late", bounds=(0.0, 60.0)
        ),
        _impair(_cable, "latency_s"),
    ),
    "link_twice": Effect(
        FaultForm(
            text="link_twice[=SHARE]", does="this share, or all, comes twice by the radio", bounds=_SHARE, default=1.0
        ),
        _impair(_radio, "duplicate"),
    ),
    "cable_twice": Effect(
        FaultForm(text="cable_twice[=SHARE]", does="the same of the cable", bounds=_SHARE, default=1.0),
        _impair(_cable, "duplicate"),
    ),
}
"""Every kind of fault of a link."""
