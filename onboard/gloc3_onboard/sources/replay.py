"""Devices that play a log: paced by the host's clock, wall or virtual, with the log's stamps mapped to our time."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Generic, NamedTuple, TypeVar

from gloc3.clock import Clock
from gloc3.errors import Gloc3Error
from gloc3.messages.perception import BottomVelocity, ImuSample, LaserScan
from gloc3.messages.vehicle import HeightAboveGround, Image
from gloc3_onboard.sensors.devices import (
    Bell,
    StampedBottomVelocity,
    StampedHeight,
    StampedImage,
    StampedImu,
    StampedPair,
    StampedScan,
    Unwatch,
)

T = TypeVar("T")
KEPT: Final = 256
LATE_S: Final = 0.05
"""What could not be given within so long after its time is left out, as a camera leaves out what nobody takes."""


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
    """Where a log's time lies in ours; shared by all devices that play the same log, so that they stay together.

    Args:
        skip_s: of the log's begin are left out.
    """

    def __init__(self, skip_s: float = 0.0) -> None:
        self._skip_s = skip_s
        self._offset_s: float | None = None

    def begin(self, first_log_s: float, now_s: float) -> None:
        """The log begins now, unless another device has begun it."""
        if self._offset_s is None:
            self._offset_s = now_s - first_log_s - self._skip_s

    def t_s(self, log_s: float) -> float:
        """Our time of a moment of the log, once it has begun."""
        return log_s + (self._offset_s or 0.0)


class Replay(Generic[T]):
    """The base of devices that play a log.

    Args:
        loop: whose time paces it; what is due is loaded off its thread, which in virtual time is the only one.
        time: of the log.
        index: reads what there is; called when the device is opened.
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
        """Begins to play, or goes on where the log is now.

        Raises:
            InputError: the log cannot be read.
        """
        self._records, self._failure = self._index(), ""
        self.forget()
        self._post(self._begin)

    def close(self) -> None:
        """Plays no more."""
        self._post(self._end)

    def on_news(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when something is due."""
        return self._bell.listen(ready)

    def check(self) -> None:
        """Raises what went wrong.

        Raises:
            Gloc3Error: the log is damaged.
        """
        if self._failure:
            raise Gloc3Error(self._failure)

    def take(self, t_s: float, item: T) -> None:
        """Keeps what is due now."""
        raise NotImplementedError

    def forget(self) -> None:
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
            self.take(self._time.t_s(record.log_s), record.load())
            self._bell.ring()
            self._wait()
            return
        loading = self._loop.run_in_executor(None, record.load)

        def loaded(done: asyncio.Future[T]) -> None:
            if life != self._life or done.cancelled():
                return
            error = done.exception()
            if error is None:
                self.take(self._time.t_s(record.log_s), done.result())
            else:
                self._failure = str(error)
            self._bell.ring()
            self._wait()

        loading.add_done_callback(loaded)


class ReplayCamera(Replay[Image]):
    """A camera of a log."""

    _frame: StampedImage | None = None

    def take(self, t_s: float, item: Image) -> None:
        """Keeps a frame."""
        self._frame = StampedImage(t_s, item)

    def forget(self) -> None:
        """Keeps nothing."""
        self._frame = None

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        self.check()
        return self._frame


class ReplayStereoCamera(Replay[tuple[Image, Image]]):
    """A stereo pair of a log."""

    _pair: StampedPair | None = None

    def take(self, t_s: float, item: tuple[Image, Image]) -> None:
        """Keeps a pair."""
        self._pair = StampedPair(t_s, *item)

    def forget(self) -> None:
        """Keeps nothing."""
        self._pair = None

    def pair(self) -> StampedPair | None:
        """The latest two frames; None before the first."""
        self.check()
        return self._pair


class ReplayLaser(Replay[LaserScan]):
    """A range scanner of a log."""

    _scan: StampedScan | None = None

    def take(self, t_s: float, item: LaserScan) -> None:
        """Keeps a turn."""
        self._scan = StampedScan(t_s, item)

    def forget(self) -> None:
        """Keeps nothing."""
        self._scan = None

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first."""
        self.check()
        return self._scan


class ReplayImu(Replay[ImuSample]):
    """An inertial unit of a log."""

    is_slow = False

    def __init__(
        self, loop: asyncio.AbstractEventLoop, time: LogTime, index: Callable[[], Sequence[Recorded[ImuSample]]]
    ) -> None:
        super().__init__(loop, time, index)
        self._samples: deque[StampedImu] = deque(maxlen=KEPT)

    def take(self, t_s: float, item: ImuSample) -> None:
        """Keeps a sample."""
        self._samples.append(StampedImu(t_s, item))

    def forget(self) -> None:
        """Keeps nothing."""
        self._samples.clear()

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        """What it felt after a time."""
        self.check()
        return [stamped for stamped in self._samples.copy() if stamped.t_s > after_s]


class ReplayHeight(Replay[HeightAboveGround]):
    """A range finder of a log; it plays while somebody listens."""

    _height: StampedHeight | None = None

    def take(self, t_s: float, item: HeightAboveGround) -> None:
        """Keeps a height."""
        self._height = StampedHeight(t_s, item)

    def forget(self) -> None:
        """Keeps nothing."""
        self._height = None

    def height(self) -> StampedHeight | None:
        """The latest height; None before the first."""
        self.check()
        return self._height

    def on_height(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a new height is due."""
        unwatch = self.on_news(ready)
        self.open()

        def end() -> None:
            unwatch()
            self.close()

        return end


class ReplayDvl(Replay[BottomVelocity]):
    """A Doppler velocity log of a log."""

    _bottom: StampedBottomVelocity | None = None

    def take(self, t_s: float, item: BottomVelocity) -> None:
        """Keeps a velocity."""
        self._bottom = StampedBottomVelocity(t_s, item)

    def forget(self) -> None:
        """Keeps nothing."""
        self._bottom = None

    def bottom_velocity(self) -> StampedBottomVelocity | None:
        """The latest velocity; None before the first."""
        self.check()
        return self._bottom
