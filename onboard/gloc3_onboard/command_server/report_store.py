"""Reports to stations, numbered and on disk, so that a station receives those it missed at the next contact."""

from typing import Annotated, Final

import msgspec
from msgspec.structs import replace

from gloc3.errors import UNREADABLE
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent
from gloc3.store import Records, RecordStore

MOST_KEPT: Final = 4000
"""Number of events on disk, some 400 kB; the oldest are dropped."""
SPARE: Final = 1000
"""Further events appended before the file is rewritten."""
MOST_TEXT: Final = 300
"""Characters of an event that are kept."""


Count = Annotated[int, msgspec.Meta(ge=0)]


class _Head(msgspec.Struct, frozen=True, array_like=True):
    """The first record."""

    store: int
    """Identifier of this store; a new store has another, under which numbers mean other events."""
    last: Count
    """Highest number issued when this was written."""
    delivered: Annotated[int, msgspec.Meta(ge=-1)]
    """Highest number delivered to a station; -1 before the first contact."""
    computer: str = ""
    """The computer's own start in which this was written."""


class ReportStore:
    """Events of a platform across restarts of its onboard process; numbers count from 1 and are unique.

    A power cut may lose the last events after their delivery: after a reboot of the computer the store has another id,
    under which their numbers mean other events.

    Args:
        records: the file.
        fresh_id: random id for a new store.
        computer: identifier of this boot of the computer.
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
        """Reason why the store could not be read or written; empty if none."""
        return self.records.problem or self._unreadable

    @property
    def id(self) -> int:
        """Identifier of this store."""
        return self._head.store

    @property
    def last(self) -> int:
        """Highest issued number; 0 for none."""
        return self._events[-1].number if self._events else self._head.last

    @property
    def delivered(self) -> int:
        """Highest number delivered to a station."""
        return max(0, self._head.delivered)

    def add(self, event: CiEvent) -> CiEvent:
        """Numbers an event and stores it; warnings are flushed to disk, others survive the process."""
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
        """Handles the first contact with a station: later events are owed to it."""
        if self._head.delivered < 0:
            self._set_delivered(self.last)

    def deliver(self, number: int) -> None:
        """Marks all events up to a number as delivered."""
        if self._head.delivered < number <= self.last:
            self._set_delivered(number)

    def undelivered(self) -> list[CiEvent]:
        """Events not yet delivered to any station."""
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
            first = self._events[0].number if self._events else 1
            if first < 1 or any(one.number != first + index for index, one in enumerate(self._events)):
                raise ValueError("their numbers do not count up from 1")
        except (*UNREADABLE, ValueError) as error:  # of another version of this program, or damaged
            self._unreadable = f"the stored events cannot be read: {error}"
            self._events.clear()
            records = []
        if not records:
            self._head = _Head(fresh_id, 0, -1, self._computer)
        if self._head.computer != self._computer:
            self._head = replace(self._head, store=fresh_id)
        self._rewrite()
