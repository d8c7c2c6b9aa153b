"""MAVLink over a serial line: pyserial in two threads, so that a stuck device never stops the loop."""

from __future__ import annotations

import asyncio
import errno
import os
import queue
import termios
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import serial


from gloc3.mavlink.codec import Parser

RATES: Final = (57_600, 115_200, 921_600, 460_800, 230_400, 500_000, 1_500_000, 38_400)
"""As autopilots' ports and radios are set, the most usual ones first."""
TRY_S: Final = 1.3
"""Longer than the second between two heartbeats."""
ENOUGH: Final = 2
"""Frames that must come: one might be chance."""


class BaudSearch:
    """Tries one baud rate after the other, without a clock or a port: the owner passes data and sets the rate."""

    def __init__(self, now_s: float) -> None:
        self.is_found = False
        self._index = 0
        self._begin(now_s)

    @property
    def rate(self) -> int:
        """The rate that is right, or is being tried."""
        return RATES[self._index]

    def receive(self, data: bytes, now_s: float) -> None:
        """Handles data received at the present rate, which may be empty."""
        if self.is_found:
            return
        self._frames += sum(frame.shape is not None for frame in self._parser.receive(data))
        if self._frames >= ENOUGH:
            self.is_found = True
        elif now_s - self._began_s > TRY_S * (2.0 if self._frames else 1.0):
            self._index = (self._index + 1) % len(RATES)
            self._begin(now_s)

    def _begin(self, now_s: float) -> None:
        self._began_s, self._frames, self._parser = now_s, 0, Parser()


READ_TIMEOUT_S: Final = 0.1
REOPEN_S: Final = 1.0
WRITE_TIMEOUT_S: Final = 1.0
LONGEST_FRAME_BYTES: Final = 280
HELD: Final = "the other end does not say that it is ready (CTS); is the line wired for flow control, and set to it?"
WAITING_FRAMES: Final = 256
"""What may wait for a slow line; beyond it the oldest are dropped."""


class SerialEndpoint:
    """A serial line, opened again each second while the device is missing."""

    is_datagram = False
    intruder = ""
    origin = ""
    local_port = None

    def __init__(
        self,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        device: str,
        baud: int | None,
        *,
        has_flow_control: bool = False,
    ) -> None:
        self.url = url
        self.bytes_received = 0
        self.bytes_sent = 0
        self.dropped = 0
        self.problem = "not open yet"
        self._loop = loop
        self._on_data = on_data
        self._device, self._has_flow_control = device, has_flow_control
        self._search = BaudSearch(loop.time()) if baud is None else None
        self._baud = baud or RATES[0]
        self._port: serial.Serial | None = None
        self._closing = threading.Event()
        self._waiting: queue.Queue[tuple[float, bytes] | None] = queue.Queue(WAITING_FRAMES)
        """Frames with the time at which they were queued."""
        self._threads = [
            threading.Thread(target=self._read, name=f"read {device}", daemon=True),
            threading.Thread(target=self._write, name=f"write {device}", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def is_connected(self) -> bool:
        """Whether the device is open, and its rate known."""
        return self._port is not None and (self._search is None or self._search.is_found)

    @property
    def baud(self) -> int:
        """The line's rate; while it is not known, the one that is tried."""
        return self._baud

    def send(self, data: bytes) -> None:
        """Queues one frame for the line."""
        if not self.is_connected:
            self.dropped += 1
            return
        if self._waiting.full():
            with suppress(queue.Empty):  # the writing thread may have emptied it
                self._waiting.get_nowait()
                self.dropped += 1
        self._waiting.put_nowait((self._loop.time(), data))

    async def close(self) -> None:
        """Ends the threads and closes the device."""
        self._closing.set()
        while not self._waiting.empty():
            self._waiting.get_nowait()
        self._waiting.put_nowait(None)
        port = self._port
        if port is not None:
            with suppress(OSError, TypeError):  # its threads may be closing it already
                port.cancel_read()
                port.cancel_write()
        for thread in self._threads:
            await self._loop.run_in_executor(None, thread.join)

    @property
    def _patience_s(self) -> float:
        """Time for which a frame may wait, and for which the line may accept none; a slow line has time for two frames."""
        return max(WRITE_TIMEOUT_S, 2 * LONGEST_FRAME_BYTES * 10 / self._baud)

    def _open(self) -> serial.Serial | None:
        import serial

        try:
            return serial.Serial(
                self._device,
                self._baud,
                timeout=READ_TIMEOUT_S,
                write_timeout=self._patience_s,
                rtscts=self._has_flow_control,
                exclusive=True,
            )
        except (OSError, ValueError) as error:
            self.problem = _reason(error)
            return None

    def _read(self) -> None:
        while not self._closing.is_set():
            port = self._open()
            if port is None:
                self._closing.wait(REOPEN_S)
                continue
            self.problem, self._port = "", port
            try:
                while not self._closing.is_set():
                    data = port.read(max(1, port.in_waiting))
                    if self._search is not None and not self._search.is_found:
                        self._try(port, self._search, data)
                    if data and self.is_connected:
                        self._loop.call_soon_threadsafe(self._receive, data)
            except (OSError, TypeError) as error:  # unplugged; pyserial answers with a TypeError if that is in mid-read
                self.problem = _reason(error)
            except RuntimeError:  # the loop is gone
                self._closing.set()
            self._port = None
            port.close()

    def _try(self, port: serial.Serial, search: BaudSearch, data: bytes) -> None:
        """Passes received data to the search, and sets the line to the rate to try next."""
        search.receive(data, self._loop.time())
        if search.rate != self._baud:
            self._baud = port.baudrate = search.rate
            port.reset_input_buffer()
        self.problem = "" if search.is_found else f"no MAVLink received yet; trying {search.rate} baud"

    def _receive(self, data: bytes) -> None:
        if not self._closing.is_set():
            self.bytes_received += len(data)
            self._on_data(data)

    def _write(self) -> None:
        while (waiting := self._waiting.get()) is not None:
            queued_s, data = waiting
            port = self._port
            if port is None or self._loop.time() - queued_s > self._patience_s:
                self.dropped += 1
                continue
            try:
                port.write(data)
                self.bytes_sent += len(data)
            except (OSError, TypeError) as error:
                is_held = self._has_flow_control and not getattr(error, "errno", None)
                self.problem = HELD if is_held else _reason(error)
                self.dropped += 1
                with suppress(OSError, TypeError, termios.error):  # the line may be closed by now
                    port.reset_output_buffer()


def _reason(error: Exception) -> str:
    """What is the matter with a line, once and in the system's words."""
    number = getattr(error, "errno", None)
    if number in (errno.EAGAIN, errno.EBUSY):
        return "in use by another program"
    return os.strerror(number).lower() if number else str(error)
