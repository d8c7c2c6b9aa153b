"""Events on the desk: store all, search, export to a file."""

import asyncio
from functools import partial
from typing import Final

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.event_export import check_target, export
from gloc3_groundstation.store.event_search import EVERYTHING, EventFilter, Search
from gloc3_groundstation.store.event_store import EventStore


class EventsDesk:
    """Keeps every event of a station, from the moment it is made."""

    def __init__(self, station: Station, store: EventStore | None = None) -> None:
        """Begins to keep events.

        Args:
            station: whose.
            store: where they are kept; None for one that goes with the process.
        """
        self._station = station
        self.store: Final = EventStore() if store is None else store
        self.search = Search(self.store)
        """What the operator looks at."""
        self._has_reported = False
        self._kept = 0
        self._receive_events(station.fleet, station.fleet, station.now_s())
        station.listen(self._receive_events)

    def search_for(self, wanted: EventFilter) -> None:
        """Looks for other events, from the newest on."""
        if wanted != self.search.wanted:
            self.search = Search(self.store, wanted)

    async def export(self, name: str, wanted: EventFilter = EVERYTHING) -> bool:
        """Writes the events that fit to a file, beside everything else that goes on."""
        self.store.flush()
        try:
            path = check_target(name)
            loop = asyncio.get_running_loop()
            count = await loop.run_in_executor(None, partial(export, self.store, wanted, path))
        except Refused as error:
            self._station.note("", Severity.ERROR, f"export: {error}")
            return False
        self._station.note("", Severity.INFO, f"{count:,} {'event is' if count == 1 else 'events are'} in {path}")
        return True

    def _receive_events(self, before: Fleet, after: Fleet, now_s: float) -> None:
        if after.event_count == self._kept:
            return
        for event in after.events_after(self._kept):
            self.store.add(event)
        self._kept = after.event_count
        if self.store.problem and not self._has_reported:
            self._has_reported = True
            self._station.note("", Severity.WARNING, self.store.problem)
