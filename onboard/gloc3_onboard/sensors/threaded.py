"""A blocking device read in its own thread: opened, lost, reopened, abandoned."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Final, Generic, TypeVar

from gloc3.component.error_handler import describe
from gloc3.errors import Gloc3Error
from gloc3_onboard.sensors.devices import Bell, Unwatch

T = TypeVar("T")

OPEN_S: Final = 4.0
"""So long a device may take to open; a component's start has 5 s."""
LEAVE_S: Final = 0.8
"""So long an earlier opening is waited for."""
AGAIN_S: Final = 0.5
GIVE_UP_S: Final = 10.0
"""Time without reconnection after which a lost device is abandoned, s."""


class ThreadedSource(ABC, Generic[T]):
    """The base of devices that block. What was read last is `latest`; readers are never blocked.

    Args:
        name: of the device, for texts and its thread.
        now_s: our time.
    """

    def __init__(self, name: str, now_s: Callable[[], float]) -> None:
        self.name = name
        self.now_s = now_s
        self._bell = Bell()
        self._latest: T | None = None
        self._is_disconnected = ""
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()

    @abstractmethod
    def connect(self) -> AbstractContextManager[Iterator[T | None]]:
        """Opens the device; yields its data, and None after a while without any. May block.

        The iterator's end or an error from it means a loss, whatever the device's library raises. The device is closed on
        exit.

        Raises:
            Gloc3Error: it cannot be opened; the message says what to do.
        """

    @property
    def is_reading(self) -> bool:
        """Whether its thread runs; else it has not been opened, or the device is lost."""
        return self._thread is not None and self._thread.is_alive()

    def open(self) -> None:
        """Starts reading.

        Raises:
            Gloc3Error: the device cannot be opened; the message says what to do.
        """
        if self._thread is not None and self._thread.is_alive():
            self._thread.join(LEAVE_S)
            if self._thread.is_alive():
                raise Gloc3Error(f"{self.name}: the device does not answer, so it cannot be reopened; unplug it")
        self._latest, self._is_disconnected, self._stop = None, "", threading.Event()
        tried = threading.Event()
        self._thread = threading.Thread(target=self._read, args=(self._stop, tried), name=self.name, daemon=True)
        self._thread.start()
        if not tried.wait(OPEN_S):
            self._stop.set()
            raise Gloc3Error(f"{self.name}: it has not opened within {OPEN_S:g} s; is another program using it?")
        if self._is_disconnected:
            raise Gloc3Error(self._is_disconnected)

    def close(self) -> None:
        """Stops reading; the thread ends when the device returns."""
        self._stop.set()

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called, from the reading thread, when there is something new."""
        return self._bell.listen(ready)

    def latest(self) -> T | None:
        """The latest data; None before the first.

        Raises:
            Gloc3Error: the device is lost.
        """
        if self._is_disconnected:
            raise Gloc3Error(self._is_disconnected)
        return self._latest

    def _read(self, stop: threading.Event, tried: threading.Event) -> None:
        lost_s: float | None = None
        problem = ""
        while not stop.is_set():
            try:
                with self.connect() as stream:
                    tried.set()
                    for item in stream:
                        if stop.is_set():
                            return
                        if item is not None:
                            self._latest, lost_s = item, None
                            self._bell.ring()
                problem = f"{self.name}: the device stopped delivering data"
            except Exception as error:  # noqa: BLE001
                is_plain = isinstance(error, (Gloc3Error, OSError))
                text = str(error) if is_plain else describe(error)
                problem = text if isinstance(error, Gloc3Error) else f"{self.name}: {text}"
            if not tried.is_set():
                self._is_disconnected = problem
                tried.set()
                return
            now_s = self.now_s()
            lost_s = now_s if lost_s is None else lost_s
            if now_s - lost_s >= GIVE_UP_S:
                self._is_disconnected = problem
                return
            stop.wait(AGAIN_S)
