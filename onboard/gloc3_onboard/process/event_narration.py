"""Reports the events of components to a person: warnings and worse, with their details."""

from collections.abc import Callable, Iterable
from typing import Final

from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope, Event, Severity

Report = Callable[[Severity, str], None]


class EventNarration:
    """Reports each event that is a warning or worse.

    Args:
        exchange: source of the events.
        platform: the platform's name.
        components: components to report; `*` for all.
        report: called with a line.
    """

    def __init__(self, exchange: Exchange, platform: str, components: Iterable[str], report: Report) -> None:
        self._report: Final = report
        self._ends = [
            exchange.subscribe(f"{platform}/components/{component}/event", self._narrate) for component in components
        ]

    def close(self) -> None:
        """Reports nothing any more."""
        for end in self._ends:
            end()

    def _narrate(self, envelope: Envelope[Event]) -> None:
        event = envelope.payload
        if event.severity <= Severity.WARNING:
            self._report(event.severity, f"{envelope.source.component}: {event.text}")
            for line in event.details.splitlines():
                self._report(event.severity, f"    {line}")
