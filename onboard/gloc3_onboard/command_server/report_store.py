"""Reports to stations, numbered and on disk, so that a station that was out of contact receives them later."""

from typing import Final

import msgspec
from msgspec.structs import replace

from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent
from gloc3.store import Records, RecordStore

MOST_KEPT: Final = 4000
"""Events on disk: some 400 kB; the oldest make room."""
SPARE: Final = 1000
"""So many more are appended before the file is written anew."""
MOST_TEXT: Final = 300
"""Characters of an event that are kept."""


class _Head(msgspec.Struct, frozen=True, array_like=True):
    """The first record."""

    store: int
    """Tells this store from one that was begun anew, whose numbers mean other events."""
    last: int
    """The highest number that was given when this was written."""
    delivered: int
    """Up to here some station has been told; -1 before the first was ever heard."""
    computer: str = ""
    """The computer's own start in which this was written."""


class ReportStore:
    """The events of a platform over all lives of its onboard process; numbers count from 1 and are never used twice.

    A power cut takes the last events with it, of which stations may have been told: when the computer has started anew the
    store has another id, under which their numbers mean other events.

    Args:
        records: the file.
        fresh_id: a random number for a store that is begun anew.
        computer: tells this start of the computer from every other.
    """

    def __init__(self, records: Records, fresh_id: int, computer: str = "") -> None:
        self.records: Final = RecordStore(records, "events")
        self._computer = computer
        self._encode = msgspec.msgpack.Encoder().encode
        self._unreadable = ""
        self._events: list[CiEvent] = []
        self._head = _Head(fresh_id & 0x7FFFFFFF, 0, -1, computer)
        self._appended = 0
        """Events and heads in the file."""
        self._load()

    @property
    def problem(self) -> str:
        """Why what was kept could not be read, or nothing can be kept any more; empty where all is well."""
        return self.records.problem or self._unreadable

    @property
    def id(self) -> int:
        """Tells this store from one that was begun anew."""
        return self._head.store

    @property
    def last(self) -> int:
        """The highest number that was given; 0 for none."""
        return self._events[-1].number if self._events else self._head.last

    @property
    def delivered(self) -> int:
        """Up to here some station has been told."""
        return max(0, self._head.delivered)

    def add(self, event: CiEvent) -> CiEvent:
        """Numbers an event and keeps it; the disk is asked to take warnings, others outlive the process."""
        kept = replace(event, number=self.last + 1, store=self.id, text=event.text[:MOST_TEXT])
        self._events.append(kept)
        if self._appended >= SPARE + MOST_KEPT:
            self._rewrite()
        else:
            self.records.append(self._encode(kept), outlives_power_cut=event.severity <= Severity.WARNING)
            self._appended += 1
        return replace(event, number=kept.number, store=self.id)

    def after(self, number: int, most: int) -> list[CiEvent]:
        """The events behind a number, in order; those that had to make room are left out."""
        first = self._events[0].number if self._events else 1
        begin = max(0, number + 1 - first)
        return self._events[begin : begin + most]

    def owe(self) -> None:
        """A station is heard for the first time ever: what comes from now on is owed."""
        if self._head.delivered < 0:
            self._set_delivered(self.last)

    def deliver(self, number: int) -> None:
        """A station has been told everything up to a number."""
        if self._head.delivered < number <= self.last:
            self._set_delivered(number)

    def undelivered(self) -> list[CiEvent]:
        """What no station has been told yet."""
        return self.after(self.delivered, MOST_KEPT)

    def _set_delivered(self, number: int) -> None:
        self._head = _Head(self.id, self.last, number, self._computer)
        self.records.append(self._encode(self._head), outlives_power_cut=False)
        self._appended += 1

    def _rewrite(self) -> None:
        self._events = self._events[-MOST_KEPT:]
        self._head = _Head(self.id, self.last, self._head.delivered, self._computer)
        self.records.rewrite([self._encode(self._head), *map(self._encode, self._events)])
        self._appended = len(self._events)

    def _load(self) -> None:
        records = self.records.load()
        self._unreadable = self.records.problem
        head, fresh_id = msgspec.msgpack.Decoder(_Head), self._head.store
        event = msgspec.msgpack.Decoder(CiEvent)
        try:
            for data in records:
                kept = msgspec.msgpack.decode(data)
                if isinstance(kept, list):
                    self._head = head.decode(data)
                else:
                    self._events.append(event.decode(data))
        except msgspec.MsgspecError as error:  # of another version of this program
            self._unreadable = f"the stored events cannot be read: {error}"
            self._events.clear()
            records = []
        if not records:
            self._head = _Head(fresh_id, 0, -1, self._computer)
        if self._head.computer != self._computer:
            self._head = replace(self._head, store=fresh_id)
        self._rewrite()
