"""Encodes messages in a thread, such as pictures, which take milliseconds that the control path does not have."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final, NamedTuple

from gloc3.log.writer import LogChannel

MOST_WAITING: Final = 32
"""Messages that may wait; more are refused."""


class EncodedMessage(NamedTuple):
    """A message for the log, with its place and times in it."""

    channel: LogChannel
    sequence: int
    log_ns: int
    publish_ns: int
    data: "Future[bytes]"
    """Its result is the record, or raises ValueError for one that no log can hold."""


class EncodingWorker:
    """One thread and the messages that wait for it, in their order."""

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._waiting: deque[EncodedMessage] = deque()

    @property
    def is_running(self) -> bool:
        """Whether messages can be submitted."""
        return self._pool is not None

    def start(self) -> None:
        """Starts the thread, once."""
        self._pool = self._pool or ThreadPoolExecutor(1, "log encoder")

    def submit(
        self, channel: LogChannel, sequence: int, log_ns: int, publish_ns: int, encode: Callable[[], bytes]
    ) -> bool:
        """Has a message encoded; returns whether there was room for it."""
        if self._pool is None or len(self._waiting) >= MOST_WAITING:
            return False
        self._waiting.append(EncodedMessage(channel, sequence, log_ns, publish_ns, self._pool.submit(encode)))
        return True

    def take(self, *, is_waiting: bool) -> Iterator[EncodedMessage]:
        """The messages that are encoded, in their order; or waits for all of them."""
        while self._waiting and (is_waiting or self._waiting[0].data.done()):
            yield self._waiting.popleft()

    def close(self) -> None:
        """Ends the thread."""
        if self._pool is not None:
            self._pool.shutdown()
