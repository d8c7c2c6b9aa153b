"""Streams the cameras' pictures to viewers: each is encoded once, in a thread, while somebody watches."""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from ipaddress import ip_address
from typing import Final, NamedTuple

from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Image
from gloc3_onboard.video.encoder import VideoEncoder, load_av
from gloc3_onboard.video.rtsp import RtspServer

EXAMPLE: Final = "127.0.0.1:8554"
_MOST_PORT: Final = 65_535


class VideoAddress(NamedTuple):
    """Where the server listens, which is also where stations find it."""

    host: str
    port: int

    def url(self, camera: str) -> str:
        """The URL of a camera's video."""
        return f"rtsp://{self.host}:{self.port}/{camera}"

    @property
    def is_open(self) -> bool:
        """Whether other computers reach it."""
        return self.host != "localhost" and not ip_address(self.host).is_loopback


def read_address(text: str) -> VideoAddress:
    """Reads `ADDRESS:PORT`.

    Raises:
        Refused: it is none, or stations could not reach it.
    """
    host, _, port = text.rpartition(":")
    is_port = port.isdecimal() and 0 < int(port) <= _MOST_PORT
    try:
        is_any = host != "localhost" and ip_address(host).is_unspecified
    except ValueError:
        is_port = False
    if not is_port:
        raise Refused(f"--video {text!r} must be an IP address and a port, as {EXAMPLE}")
    if is_any:
        raise Refused(f"--video {text!r}: stations use this address; give the one by which they reach this computer")
    return VideoAddress(host, int(port))


class CameraVideo:
    """One camera's video, which is encoded while it has viewers.

    Args:
        camera: its name.
        topics: pattern of the topics of pictures.
        exchange: the platform's middleware.
        loop: the process's loop.
    """

    def __init__(self, camera: str, topics: str, exchange: Exchange, loop: asyncio.AbstractEventLoop) -> None:
        self._camera, self._topics, self._exchange, self._loop = camera, topics, exchange, loop
        self._viewers: list[Callable[[list[bytes]], None]] = []
        self._unsubscribe: Callable[[], None] | None = None
        self._worker: ThreadPoolExecutor | None = None
        self._encoder: VideoEncoder | None = None
        self._is_busy = self._needs_key = False

    def watch(self, viewer: Callable[[list[bytes]], None]) -> Callable[[], None]:
        """Has the packets of each picture sent to a viewer, a whole picture first; returns a function that ends this."""
        self._viewers.append(viewer)
        self._needs_key = True
        if self._worker is None:
            self._worker = ThreadPoolExecutor(1, thread_name_prefix=f"video {self._camera}")
        if self._unsubscribe is None:
            self._unsubscribe = self._exchange.subscribe(self._topics, self._receive)

        def unwatch() -> None:
            self._viewers.remove(viewer)
            if not self._viewers:
                self._stop()

        return unwatch

    def close(self) -> None:
        """Stops encoding for good."""
        self._stop()
        if self._worker is not None:
            self._worker.shutdown(wait=False)
            self._worker = None

    def _stop(self) -> None:
        """Stops until somebody watches again."""
        if self._unsubscribe is not None and self._worker is not None:
            self._unsubscribe()
            self._unsubscribe = None
            self._worker.submit(self._end_encoder)

    def _end_encoder(self) -> None:
        if self._encoder is not None:
            self._encoder.close()
            self._encoder = None

    def _receive(self, envelope: Envelope[Image]) -> None:
        """Has a picture encoded, unless the one before is still at it."""
        image = envelope.payload
        if image.camera != self._camera or not image.is_valid or self._is_busy or self._worker is None:
            return
        self._is_busy = True
        is_key, self._needs_key = self._needs_key, False
        job = self._worker.submit(self._encode, image, envelope.t_s, is_key)
        job.add_done_callback(self._finish)

    def _finish(self, job: Future[list[bytes]]) -> None:
        """Hands the packets to the loop."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._encoded, job.result)

    def _encode(self, image: Image, t_s: float, is_key: bool) -> list[bytes]:
        size = image.width // 2 * 2, image.height // 2 * 2
        if self._encoder is None or self._encoder.size != size:
            self._end_encoder()
            self._encoder = VideoEncoder(*size)
        return self._encoder.encode(image, t_s, is_key=is_key)

    def _encoded(self, result: Callable[[], list[bytes]]) -> None:
        self._is_busy = False
        packets = result()
        for viewer in list(self._viewers):
            viewer(packets)


class VideoStreams:
    """The server with the video of each camera.

    Args:
        cameras: their names.
        platform: the platform's name.
        exchange: the platform's middleware.
        loop: the process's loop.
    """

    def __init__(
        self, cameras: Sequence[str], platform: str, exchange: Exchange, loop: asyncio.AbstractEventLoop
    ) -> None:
        self._videos = {name: CameraVideo(name, f"{platform}/camera/*", exchange, loop) for name in cameras}
        self._server = RtspServer(self._videos)

    async def open(self, address: VideoAddress) -> None:
        """Listens.

        Raises:
            Refused: the address cannot be had.
        """
        load_av()
        try:
            await self._server.open(*address)
        except OSError as error:
            raise Refused(f"--video {address.host}:{address.port}: {error.strerror}") from error

    @property
    def port(self) -> int:
        """The port in use."""
        return self._server.port

    def close(self) -> None:
        """Ends all connections and encoders."""
        self._server.close()
        for video in self._videos.values():
            video.close()
