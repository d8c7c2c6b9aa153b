"""Devices that play a log: paced by the host's clock, wall or virtual, with the log's stamps mapped to our time."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, Generic, NamedTuple, TypeVar

from gloc3.clock import Clock
from gloc3.errors import Finding, Gloc3Error, InputError, nearest
from gloc3.log.reader import LogReader
from gloc3.messages.envelope import Message
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Bell, Unwatch

T = TypeVar("T")
M = TypeVar("M", bound=Message)
LATE_S: Final = 0.05
"""Lateness above which a record is skipped, s, as a camera drops frames."""


class Recorded(NamedTuple, Generic[T]):
    """One thing of a log."""

    log_s: float
    """When it was valid, in the log's own time."""
    load: Callable[[], T]
    """Gives it; may read a file."""


def together(left: Recorded[T], right: Recorded[T]) -> "Recorded[tuple[T, T]]":
    """Two things of a log as one, with the first one's time."""
    return Recorded(left.log_s, lambda: (left.load(), right.load()))


def matching(left: Sequence[Recorded[T]], right: Sequence[Recorded[T]]) -> "list[Recorded[tuple[T, T]]]":
    """Those of two lists that have the same time."""
    rights = {record.log_s: record for record in right}
    return [together(record, rights[record.log_s]) for record in left if record.log_s in rights]


class LogTime:
    """Offset of a log's time to ours; shared by all devices that play the same log, so that they stay together.

    Args:
        skip_s: of the log's begin are left out.
    """

    def __init__(self, skip_s: float = 0.0) -> None:
        self._skip_s = skip_s
        self._offset_s: float | None = None

    def begin(self, first_log_s: float, now_s: float) -> None:
        """Starts the log's time now, unless another device has started it."""
        if self._offset_s is None:
            self._offset_s = now_s - first_log_s - self._skip_s

    def t_s(self, log_s: float) -> float:
        """Our time of a moment of the log, after the start."""
        return log_s + (self._offset_s or 0.0)


class Replay(Generic[T]):
    """The base of devices that play a log.

    Args:
        loop: event loop that paces it; records are loaded off its thread, except in virtual time.
        time: time base of the log.
        index: reads the index of records; called when the device is opened.
    """

    is_slow = True
    """Whether to load one takes long."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, time: LogTime, index: Callable[[], Sequence[Recorded[T]]]
    ) -> None:
        self._loop, self._time, self._index = loop, time, index
        self._is_virtual = Clock(loop).is_virtual
        self._records: Sequence[Recorded[T]] = ()
        self._next = 0
        self._timer: asyncio.TimerHandle | None = None
        self._bell = Bell()
        self._failure = ""
        self._life = 0

    def open(self) -> None:
        """Starts playing, or continues at the log's present time.

        Raises:
            InputError: the log cannot be read.
        """
        self._records, self._failure = self._index(), ""
        self.clear()
        self._post(self._begin)

    def close(self) -> None:
        """Plays no more."""
        self._post(self._end)

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when something is due."""
        return self._bell.listen(ready)

    def check(self) -> None:
        """Raises what went wrong.

        Raises:
            Gloc3Error: the log is damaged.
        """
        if self._failure:
            raise Gloc3Error(self._failure)

    def play(self, t_s: float, item: T) -> None:
        """Stores the record that is due now."""
        raise NotImplementedError

    def clear(self) -> None:
        """Keeps nothing of an earlier opening."""
        raise NotImplementedError

    def _post(self, call: Callable[[], None]) -> None:
        if self._is_virtual:
            call()
        else:
            self._loop.call_soon_threadsafe(call)

    def _begin(self) -> None:
        self._end()
        if self._records:
            self._time.begin(self._records[0].log_s, self._loop.time())
            self._next = 0
            self._wait()

    def _end(self) -> None:
        self._life += 1
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _wait(self) -> None:
        """Waits for the next that is not long past."""
        now_s, records = self._loop.time(), self._records
        while self._next < len(records) and self._time.t_s(records[self._next].log_s) < now_s - LATE_S:
            self._next += 1
        if self._next < len(records):
            self._timer = self._loop.call_at(self._time.t_s(records[self._next].log_s), self._due)

    def _due(self) -> None:
        record, life = self._records[self._next], self._life
        self._next += 1
        if not self.is_slow:
            self.play(self._time.t_s(record.log_s), record.load())
            self._bell.ring()
            self._wait()
            return
        loading = self._loop.run_in_executor(None, record.load)

        def loaded(done: asyncio.Future[T]) -> None:
            if life != self._life or done.cancelled():
                return
            error = done.exception()
            if error is None:
                self.play(self._time.t_s(record.log_s), done.result())
            else:
                self._failure = str(error)
            self._bell.ring()
            self._wait()

        loading.add_done_callback(loaded)


def topic_records(path: Path, topic: str, kind: type[M]) -> Sequence[Recorded[M]]:
    """The messages of a topic, given below the platform's name.

    Raises:
        InputError: the file is not a log, or has no such topic of this type.
    """
    with LogReader(path) as reader:
        reader.require_ours("data of sensors")
        found = [
            Recorded(entry.envelope.t_s, partial(_same, entry.envelope.payload))
            for entry in reader.entries(topic)
            if isinstance(entry.envelope.payload, kind)
        ]
        if not found:
            known = [name.partition("/")[2] for name in reader.topics]
            hint = nearest(topic, known)
            if kind is Image:
                hint = "pictures are not logged unless their topic's row says so"
            message = f"it has no {kind.__name__} in {topic!r}"
            raise InputError([Finding(file=str(path), message=message, hint=hint)])
    return sorted(found, key=lambda record: record.log_s)


def _same(message: M) -> M:
    return message
