"""Reports the events of components to a person: warnings and worse, with their details."""

from collections.abc import Callable, Iterable
from typing import Final

from gloc3.documents.characters import printable
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope, Event, Severity
from gloc3_onboard.process.journal import SystemdJournal

Report = Callable[[Severity, str], None]


class EventNarration:
    """Reports each event that is a warning or worse.

    Args:
        exchange: source of the events.
        platform: the platform's name.
        components: components to report; `*` for all.
        report: called with a line.
        journal: takes an event as one entry with fields instead, where there is one.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: str,
        components: Iterable[str],
        report: Report,
        journal: SystemdJournal | None = None,
    ) -> None:
        self._platform, self._report, self._journal = platform, report, journal
        self._ends: Final = [
            exchange.subscribe(f"{platform}/components/{component}/event", self._narrate) for component in components
        ]

    def close(self) -> None:
        """Reports nothing any more, and closes the journal."""
        for end in self._ends:
            end()
        if self._journal is not None:
            self._journal.close()

    def _narrate(self, envelope: Envelope[Event]) -> None:
        event = envelope.payload
        if event.severity > Severity.WARNING or self._is_in_journal(envelope):
            return
        self._report(event.severity, f"{envelope.source.component}: {event.text}")
        for line in event.details.splitlines():
            self._report(event.severity, f"    {line}")

    def _is_in_journal(self, envelope: Envelope[Event]) -> bool:
        if self._journal is None:
            return False
        event, component = envelope.payload, envelope.source.component
        text = printable("\n".join(filter(None, (f"onboard: {component}: {event.text}", event.details))))
        fields = {"PLATFORM": self._platform, "COMPONENT": component, "EVENT": printable(event.text)}
        return self._journal.send(event.severity, text, {**fields, "CAUSE": printable(event.cause)})
