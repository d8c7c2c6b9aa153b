"""A UDP link that is slow and loses datagrams, between a client and a port of this computer, in a thread of its own."""

import heapq
import random
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_ID_AT = 7
"""Where a MAVLink 2 frame has its message id."""


class Relay:
    """Passes datagrams to a port and back."""

    def __init__(self, port: int, *, loss: float, delay_s: float, seed: int) -> None:
        self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._front.bind(("127.0.0.1", 0))
        self._back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._back.connect(("127.0.0.1", port))
        self._client: tuple[str, int] | None = None
        self._under_way: list[tuple[float, int, bool, bytes]] = []
        self._loss, self._delay_s, self._chance, self._count = loss, delay_s, random.Random(seed), 0
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.port: int = self._front.getsockname()[1]
        self.is_cut = False
        """While true nothing passes."""
        self.dropped_id: int | None = None
        """Message that does not pass."""

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._ends.set()
        self._thread.join()
        self._front.close()
        self._back.close()

    def _run(self) -> None:
        while not self._ends.is_set():
            wait_s = 0.05
            if self._under_way:
                wait_s = max(0.0, min(wait_s, self._under_way[0][0] - time.monotonic()))
            for end in select.select([self._front, self._back], [], [], wait_s)[0]:
                try:
                    data, sender = end.recvfrom(2048)
                except ConnectionError:
                    continue
                if end is self._front:
                    self._client = sender
                if len(data) > _ID_AT and data[_ID_AT] == self.dropped_id and not any(data[_ID_AT + 1 : _ID_AT + 3]):
                    continue
                if not self.is_cut and self._chance.random() >= self._loss:
                    self._count += 1
                    row = (time.monotonic() + self._delay_s, self._count, end is self._front, data)
                    heapq.heappush(self._under_way, row)
            self._deliver()

    def _deliver(self) -> None:
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            _, _, is_forth, data = heapq.heappop(self._under_way)
            if is_forth:
                with suppress(ConnectionError):  # nobody is there yet, or any more
                    self._back.send(data)
            elif self._client is not None:
                self._front.sendto(data, self._client)


@contextmanager
def relay(port: int, *, loss: float = 0.0, delay_s: float = 0.0, seed: int = 1) -> Iterator[Relay]:
    """A relay while it runs; its `port` is where the client sends to."""
    link = Relay(port, loss=loss, delay_s=delay_s, seed=seed)
    link.start()
    try:
        yield link
    finally:
        link.stop()
