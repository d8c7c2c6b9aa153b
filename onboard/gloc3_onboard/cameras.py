"""Cameras as devices of the onboard process."""

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from urllib.parse import urlsplit

from gloc3.errors import Refused
from gloc3.frame_stream import FrameError, FrameReader, GreyFrame
from gloc3.vehicle import Image
from gloc3_onboard.devices import Bell, StampedImage, Unwatch

CONNECT_S = 2.0
RETRY_S = 0.5


class NoCamera:
    """A camera that is not plugged in."""

    def open(self) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing happens."""

    def on_news(self, ready: Callable[[], None]) -> Unwatch:
        """There is never any."""
        return lambda: None

    def frame(self) -> StampedImage | None:
        """There is never a frame."""
        return None


class StreamCamera:
    """A simulated camera's frames over TCP, read in a thread of its own.

    Args:
        name: of the camera, whatever the stream calls it.
        url: `tcp://HOST:PORT`.
        t_s_of: maps the vehicle's time since boot, in seconds, to ours; None while that is not known.

    Raises:
        Refused: the URL is wrong.
    """

    def __init__(self, name: str, url: str, t_s_of: Callable[[float], float | None]) -> None:
        self._name = name
        self._address = _address(url)
        self._t_s_of = t_s_of
        self._frame: StampedImage | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._bell = Bell()

    def on_news(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a frame has come."""
        return self._bell.listen(ready)

    def open(self) -> None:
        """Begins to take frames; a stream that breaks is opened anew."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, args=(self._stop,), name="camera", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends taking frames."""
        self._stop.set()

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        return self._frame

    def _read(self, stop: threading.Event) -> None:
        while not stop.is_set():
            with suppress(OSError, FrameError), socket.create_connection(self._address, CONNECT_S) as stream:
                reader = FrameReader()
                while not stop.is_set():
                    data = stream.recv(1 << 20)
                    if not data:
                        break
                    for frame in reader.receive(data):
                        self._take(frame)
            stop.wait(RETRY_S)

    def _take(self, frame: GreyFrame) -> None:
        t_s = self._t_s_of(frame.boot_us * 1e-6)
        if t_s is not None:
            image = Image(camera=self._name, width=frame.width, height=frame.height, data=frame.data)
            self._frame = StampedImage(t_s, image)
            self._bell.ring()


def _address(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    with suppress(ValueError):
        if parts.scheme == "tcp" and parts.hostname and parts.port:
            return parts.hostname, parts.port
    raise Refused(f"camera {url!r}: write it as tcp://127.0.0.1:5600")
