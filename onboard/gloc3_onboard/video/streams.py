"""Streams the cameras' pictures to viewers: each is encoded once, in a thread, while somebody watches."""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from ipaddress import ip_address
from typing import Final, NamedTuple

from gloc3.camera.model import CameraModel
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Image, Pose
from gloc3_onboard.video.encoder import PAYLOAD_TYPE, TRANSPORT_TYPE, EncodedPicture, VideoEncoder, load_av
from gloc3_onboard.video.klv import local_set
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


WITH_POSES: Final = ".ts"
"""End of the name of a video with poses."""
POSE_GAP_S: Final = 0.25
"""Greatest difference between the times of a picture and its pose."""
_VIDEO: Final = (
    f"m=video 0 RTP/AVP {PAYLOAD_TYPE}",
    f"a=rtpmap:{PAYLOAD_TYPE} H264/90000",
    f"a=fmtp:{PAYLOAD_TYPE} packetization-mode=1",
)
_TRANSPORT: Final = (f"m=video 0 RTP/AVP {TRANSPORT_TYPE}", f"a=rtpmap:{TRANSPORT_TYPE} MP2T/90000")

ShowPicture = Callable[[EncodedPicture], None]


class VideoSource(NamedTuple):
    """What the videos are made of."""

    platform: str
    exchange: Exchange
    loop: asyncio.AbstractEventLoop
    utc_offset_s: Callable[[], float | None] = lambda: None
    """From the platform's time to seconds since 1970; None while unknown."""


class StreamedCamera(NamedTuple):
    """A camera with a video."""

    name: str
    model: CameraModel | None = None
    """Its calibration; None if unknown."""
    is_fixed: bool = True
    """Whether it is fixed to the body; else it is on a gimbal."""


class CameraVideo:
    """One camera's video, which is encoded while it has viewers.

    Args:
        camera: the camera.
        source: where its pictures come from.
        pose: returns the vehicle's latest pose.
    """

    def __init__(self, camera: StreamedCamera, source: VideoSource, pose: Callable[[], Envelope[Pose] | None]) -> None:
        self._camera, self._source, self._pose = camera, source, pose
        self._loop = source.loop
        self._viewers: list[ShowPicture] = []
        self._unsubscribe: Callable[[], None] | None = None
        self._worker: ThreadPoolExecutor | None = None
        self._encoder: VideoEncoder | None = None
        self._is_busy = self._needs_key = False

    def watch(self, viewer: ShowPicture) -> Callable[[], None]:
        """Has the packets of each picture sent to a viewer, a whole picture first; returns a function that ends this."""
        self._viewers.append(viewer)
        self._needs_key = True
        if self._worker is None:
            self._worker = ThreadPoolExecutor(1, thread_name_prefix=f"video {self._camera.name}")
        if self._unsubscribe is None:
            self._unsubscribe = self._source.exchange.subscribe(f"{self._source.platform}/camera/*", self._receive)

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
        if image.camera != self._camera.name or not image.is_valid or self._is_busy or self._worker is None:
            return
        self._is_busy = True
        is_key, self._needs_key = self._needs_key, False
        job = self._worker.submit(self._encode, image, envelope.t_s, self._pose_at(envelope.t_s), is_key)
        job.add_done_callback(self._finish)

    def _pose_at(self, t_s: float) -> bytes:
        """The KLV set of a picture; empty where time or pose is not known."""
        pose, offset_s = self._pose(), self._source.utc_offset_s()
        if offset_s is None or pose is None or not pose.payload.is_valid or abs(pose.t_s - t_s) > POSE_GAP_S:
            return b""
        time_us = round((t_s + offset_s) * 1e6)
        return local_set(time_us, pose.payload, self._camera.name, self._camera.model, is_fixed=self._camera.is_fixed)

    def _finish(self, job: Future[EncodedPicture]) -> None:
        """Hands the packets to the loop."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._encoded, job.result)

    def _encode(self, image: Image, t_s: float, pose: bytes, is_key: bool) -> EncodedPicture:
        size = image.width // 2 * 2, image.height // 2 * 2
        if self._encoder is None or self._encoder.size != size:
            self._end_encoder()
            self._encoder = VideoEncoder(*size)
        return self._encoder.encode(image, t_s, pose, is_key=is_key)

    def _encoded(self, result: Callable[[], EncodedPicture]) -> None:
        self._is_busy = False
        picture = result()
        for viewer in list(self._viewers):
            viewer(picture)


class _Form:
    """A camera's video in one of its two forms."""

    def __init__(
        self, video: CameraVideo, media: tuple[str, ...], part: Callable[[EncodedPicture], list[bytes]]
    ) -> None:
        self.media, self._video, self._part = media, video, part

    def watch(self, viewer: Callable[[list[bytes]], None]) -> Callable[[], None]:
        """Has the packets of each picture sent to a viewer, a whole picture first; returns a function that ends this."""
        return self._video.watch(lambda picture: viewer(self._part(picture)))


class VideoStreams:
    """The server with the videos of each camera: `NAME`, and `NAME.ts` with poses.

    Args:
        cameras: the cameras.
        source: where pictures and poses come from.
    """

    def __init__(self, cameras: Sequence[StreamedCamera], source: VideoSource) -> None:
        self._latest: Envelope[Pose] | None = None
        self._videos = {camera.name: CameraVideo(camera, source, lambda: self._latest) for camera in cameras}
        plain = {name: _Form(video, _VIDEO, lambda one: one.video) for name, video in self._videos.items()}
        packed = {
            name + WITH_POSES: _Form(video, _TRANSPORT, lambda one: one.transport)
            for name, video in self._videos.items()
        }
        self._server = RtspServer(plain | packed)
        self._unsubscribe = source.exchange.subscribe(f"{source.platform}/pose", self._receive_pose)

    def _receive_pose(self, envelope: Envelope[Pose]) -> None:
        if envelope.payload.is_sound():
            self._latest = envelope

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
        self._unsubscribe()
        self._server.close()
        for video in self._videos.values():
            video.close()
