"""Journal of the stations' requests and replies on disk; no request is executed twice (DESIGN §7)."""

from collections import OrderedDict
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.errors import UNREADABLE
from gloc3.messages.command_interface import CiReply, CiRequest, Outcome
from gloc3.store import Records

REMEMBERED: Final = 256
"""Requests kept for each sender."""
MOST_SENDERS: Final = 16
MOST_FLOORS: Final = 1024
"""Lives of senders of which it is remembered how far they had come, when their requests are not remembered any more."""
COMPACT_AFTER: Final = 4 * REMEMBERED
"""Number of records after which the file is rewritten."""


class _Record(msgspec.Struct, frozen=True, array_like=True):
    sender: str
    boot: int
    sequence: int
    reply: CiReply | None
    """None for a request that has started and has no known end."""
    is_floor: bool = False
    """Not a request: all up to this one are older than the stored requests."""


class KnownRequest(NamedTuple):
    """A request in the journal."""

    is_new: bool
    reply: CiReply | None = None
    """What to answer a request that is not new; None while it is still being carried out."""


class Journal:
    """The last requests of each sender. `begin` is written before a request is executed, `end` with its reply."""

    def __init__(self, store: Records) -> None:
        self._store = store
        self._senders: OrderedDict[str, OrderedDict[tuple[int, int], CiReply | None]] = OrderedDict()
        self._floors: OrderedDict[tuple[str, int], int] = OrderedDict()
        self._running: set[tuple[str, int, int]] = set()
        self.unreadable = 0
        """Records of another version of this program, left out."""
        records = store.load()
        self._records = len(records)
        decoder = msgspec.msgpack.Decoder(_Record)
        for data in records:
            try:
                record = decoder.decode(data)
            except UNREADABLE:
                self.unreadable += 1
            else:
                self._note(record)

    def begin(self, request: CiRequest) -> KnownRequest:
        """Whether a request is to be executed; if so, its record is on its way to disk on return."""
        known = self._senders.get(request.sender, OrderedDict())
        key = (request.boot, request.sequence)
        if key in known:
            return KnownRequest(False, known[key] if known[key] is not None else self._unfinished(request))
        if request.sequence <= self._floors.get((request.sender, request.boot), -1):
            return KnownRequest(False, _reply(request, Outcome.EXPIRED, "older than the stored requests"))
        self._running.add((request.sender, *key))
        self._write(_Record(request.sender, request.boot, request.sequence, None))
        return KnownRequest(True)

    def end(self, reply: CiReply) -> None:
        """Keeps the reply to a request that has been executed."""
        self._running.discard((reply.sender, reply.boot, reply.sequence))
        self._write(_Record(reply.sender, reply.boot, reply.sequence, reply))

    def query(self, sender: str, boot: int, sequence: int) -> tuple[Outcome, CiReply | None]:
        """What became of an earlier request of a sender; one that is still carried out is *unknown* as yet."""
        known = self._senders.get(sender, OrderedDict())
        reply = known.get((boot, sequence))
        if reply is not None:
            return reply.outcome, reply
        if (boot, sequence) not in known and sequence <= self._floors.get((sender, boot), -1):
            return Outcome.EXPIRED, None
        return Outcome.UNKNOWN, None

    def _unfinished(self, request: CiRequest) -> CiReply | None:
        if (request.sender, request.boot, request.sequence) in self._running:
            return None
        return _reply(request, Outcome.UNKNOWN, "the process ended while it was carried out")

    def _write(self, record: _Record) -> None:
        self._note(record)
        self._records += 1
        if self._records < COMPACT_AFTER:
            self._store.append(msgspec.msgpack.encode(record))
            return
        kept = [_Record(*place, floor, None, is_floor=True) for place, floor in self._floors.items()]
        for sender, known in self._senders.items():
            kept += [_Record(sender, boot, sequence, reply) for (boot, sequence), reply in known.items()]
        self._store.rewrite([msgspec.msgpack.encode(one) for one in kept])
        self._records = min(len(kept), COMPACT_AFTER - REMEMBERED)

    def _note(self, record: _Record) -> None:
        if record.is_floor:
            self._raise_floor(record.sender, record.boot, record.sequence)
            return
        known = self._senders.setdefault(record.sender, OrderedDict())
        self._senders.move_to_end(record.sender)
        known[record.boot, record.sequence] = record.reply
        while len(known) > REMEMBERED:
            (boot, sequence), _ = known.popitem(last=False)
            self._raise_floor(record.sender, boot, sequence)
        while len(self._senders) > MOST_SENDERS:
            sender, forgotten = self._senders.popitem(last=False)
            for boot, sequence in forgotten:
                self._raise_floor(sender, boot, sequence)

    def _raise_floor(self, sender: str, boot: int, sequence: int) -> None:
        place = (sender, boot)
        self._floors[place] = max(self._floors.pop(place, -1), sequence)
        while len(self._floors) > MOST_FLOORS:
            self._floors.popitem(last=False)


def _reply(request: CiRequest, outcome: Outcome, reason: str) -> CiReply:
    return CiReply(sender=request.sender, boot=request.boot, sequence=request.sequence, outcome=outcome, reason=reason)


def answer(
    request: CiRequest,
    outcome: Outcome = Outcome.ACCEPTED,
    reason: str = "",
    *,
    text: str = "",
    result: dict[str, Any] | None = None,
) -> CiReply:
    """A reply to that request; accepted unless it says otherwise."""
    return CiReply(
        sender=request.sender,
        boot=request.boot,
        sequence=request.sequence,
        outcome=outcome,
        reason=reason,
        text=text,
        result=result or {},
    )
