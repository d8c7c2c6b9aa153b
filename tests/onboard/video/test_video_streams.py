"""Video of a camera over RTSP, read by OpenCV's and PyAV's FFmpeg: its pictures, viewers who come and go, wrong requests."""

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from math import pi, radians

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.camera.model import CameraModel
from gloc3.errors import Refused
from gloc3.exchange import Publisher
from gloc3.exchange.base import LocalExchange
from gloc3.messages.frames import from_euler
from gloc3.messages.vehicle import Image, Pose
from gloc3_onboard.video.streams import StreamedCamera, VideoAddress, VideoSource, VideoStreams, read_address

av = pytest.importorskip("av")

pytestmark = [pytest.mark.sockets]

WIDTH, HEIGHT = 320, 240
UTC_OFFSET_S = 1_700_000_000.0
MODEL = CameraModel(
    width=WIDTH,
    height=HEIGHT,
    focal_px=(160.0, 160.0),
    center_px=(160.0, 120.0),
    frd_from_rdf=from_euler(0.0, 0.0, pi / 2),
)
"""It looks down, with the top of its picture ahead."""
POSE = Pose(
    position_ned_m=(0.0, 0.0, -20.0),
    velocity_ned_m_s=(0.0, 0.0, 0.0),
    ned_from_frd=from_euler(radians(3.0), radians(-2.0), radians(160.0)),
    origin_geo=(39.5528, 2.6285, 2.0),
)
Picture = NDArray[np.uint8]


def picture(number: int) -> Picture:
    """A smooth coloured picture with a white square, which moves from picture to picture."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    pixels = np.dstack([columns * 0.5, rows * 0.7, 160.0 - columns * 0.2]).astype(np.uint8)
    x = 20 + 10 * (number % 20)
    pixels[100:140, x : x + 40] = 255
    return pixels


class Scene:
    """A server whose camera takes pictures."""

    def __init__(self, exchange: LocalExchange, streams: VideoStreams) -> None:
        self.streams = streams
        self._publisher = Publisher(exchange, "boat", "camera", 1)
        self.taken = 0

    def url(self, camera: str = "ground") -> str:
        return VideoAddress("127.0.0.1", self.streams.port).url(camera)

    async def take(self, *, is_coloured: bool = True) -> None:
        """A picture each twentieth of a second, for good."""
        while True:
            pixels = picture(self.taken)
            grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY).tobytes()
            bgr = pixels.tobytes() if is_coloured else b""
            image = Image(camera="ground", width=WIDTH, height=HEIGHT, data=grey, bgr=bgr)
            self._publisher.publish("boat/pose", POSE, self.taken * 0.05)
            self._publisher.publish("boat/camera/down", image, self.taken * 0.05)
            self.taken += 1
            await asyncio.sleep(0.05)


@asynccontextmanager
async def serving(*, is_coloured: bool = True) -> AsyncIterator[Scene]:
    exchange = LocalExchange()
    source = VideoSource("boat", exchange, asyncio.get_running_loop(), lambda: UTC_OFFSET_S)
    streams = VideoStreams([StreamedCamera("ground", MODEL)], source)
    await streams.open(VideoAddress("127.0.0.1", 0))
    scene = Scene(exchange, streams)
    taking = asyncio.create_task(scene.take(is_coloured=is_coloured))
    try:
        yield scene
    finally:
        taking.cancel()
        streams.close()
        await asyncio.sleep(0.1)  # connections end


def seen_by_opencv(url: str, count: int) -> list[Picture]:
    capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG)
    try:
        assert capture.isOpened()
        found = [capture.read() for _ in range(count)]
    finally:
        capture.release()
    assert all(is_there for is_there, _ in found)
    return [np.asarray(frame, np.uint8) for _, frame in found]


def seen_by_pyav(url: str, count: int, transport: str) -> list[tuple[float | None, Picture]]:
    found: list[tuple[float | None, Picture]] = []
    with av.open(url, options={"rtsp_transport": transport}, timeout=20.0) as container:
        for frame in container.decode(video=0):
            found.append((frame.time, frame.to_ndarray(format="bgr24")))
            if len(found) == count:
                break
    return found


def nearest(frame: Picture) -> float:
    """Mean difference from the most similar of the camera's pictures."""
    return min(float(np.abs(frame.astype(int) - picture(number).astype(int)).mean()) for number in range(20))


@pytest.mark.parametrize("is_coloured", [True, False])
async def test_opencv_reads_the_cameras_pictures(is_coloured: bool) -> None:
    async with serving(is_coloured=is_coloured) as scene:
        frames = await asyncio.to_thread(seen_by_opencv, scene.url(), 10)
    assert frames[0].shape == (HEIGHT, WIDTH, 3)
    if is_coloured:
        assert max(nearest(frame) for frame in frames) < 6.0
    else:
        grey = cv2.cvtColor(picture(0), cv2.COLOR_BGR2GRAY)
        assert np.abs(frames[-1][:80].mean(axis=2) - grey[:80]).mean() < 6.0
    assert np.abs(frames[0].astype(int) - frames[-1].astype(int)).max() > 100, "the square has moved"


async def test_two_viewers_see_it_at_once_and_a_third_later_and_times_are_those_of_the_pictures() -> None:
    async with serving() as scene:
        both = [asyncio.to_thread(seen_by_pyav, scene.url(), 12, transport) for transport in ("tcp", "tcp")]
        for frames in await asyncio.gather(*both):
            steps = np.diff([t_s for t_s, _ in frames if t_s is not None])
            assert len(steps) >= 8
            assert steps == pytest.approx(np.round(steps / 0.05) * 0.05, abs=1e-3)
            assert max(nearest(frame) for _, frame in frames) < 6.0
        for _ in range(3):  # the encoder ends with the last viewer, and begins anew with the next
            later = await asyncio.to_thread(seen_by_pyav, scene.url(), 2, "tcp")
            assert nearest(later[0][1]) < 6.0, "it begins with a whole picture"


async def request(port: int, text: str) -> str:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(text.encode("latin-1"))
    answer = await asyncio.wait_for(reader.read(2000), 10.0)
    writer.close()
    return answer.decode()


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("OPTIONS * RTSP/1.0\r\nCSeq: 1\r\n\r\n", "RTSP/1.0 200 OK\r\nCSeq: 1\r\n"),
        ("DESCRIBE rtsp://h/nothing RTSP/1.0\r\nCSeq: 2\r\n\r\n", "RTSP/1.0 404 "),
        (
            "SETUP rtsp://h/ground/video RTSP/1.0\r\nCSeq: 3\r\nTransport: RTP/AVP;unicast;client_port=4-5\r\n\r\n",
            "RTSP/1.0 461 ",
        ),
        (
            "SETUP rtsp://h/ground/video RTSP/1.0\r\nCSeq: 3\r\nTransport: RTP/AVP/TCP;interleaved=999-1\r\n\r\n",
            "RTSP/1.0 461 ",
        ),
        ("PLAY rtsp://h/ground RTSP/1.0\r\nCSeq: 4\r\n\r\n", "RTSP/1.0 455 "),
        ("RECORD rtsp://h/ground RTSP/1.0\r\nCSeq: 5\r\n\r\n", "RTSP/1.0 405 "),
        ("GET / HTTP/1.1\r\nHost: h\r\n\r\n", "RTSP/1.0 400 "),
        ("\r\n\r\n\r\n\r\n", "RTSP/1.0 400 "),
    ],
)
async def test_requests_that_are_wrong_get_the_protocols_answer(text: str, status: str) -> None:
    async with serving() as scene:
        assert (await request(scene.streams.port, text)).startswith(status)
        assert (await request(scene.streams.port, "OPTIONS * RTSP/1.0\r\nCSeq: 9\r\n\r\n")).startswith("RTSP/1.0 200")


async def test_a_flood_ends_the_connection_and_too_many_viewers_are_turned_away() -> None:
    async with serving() as scene:
        assert await request(scene.streams.port, "A" * 20_000) == ""
        ends = [await asyncio.open_connection("127.0.0.1", scene.streams.port) for _ in range(8)]
        await asyncio.sleep(0.1)
        assert (await request(scene.streams.port, "")).startswith("RTSP/1.0 453 ")
        for _, writer in ends:
            writer.close()


@pytest.mark.parametrize(
    "text", ["8554", "nowhere:8554", "127.0.0.1:0", "127.0.0.1:x", "0.0.0.0:8554", "127.0.0.1:70000"]
)
def test_an_address_that_stations_cannot_use_is_refused(text: str) -> None:
    with pytest.raises(Refused, match="--video"):
        read_address(text)


async def test_a_port_that_is_taken_is_refused_with_the_reason() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        streams = VideoStreams([], VideoSource("boat", LocalExchange(), asyncio.get_running_loop()))
        with pytest.raises(Refused, match=r"--video 127\.0\.0\.1:\d+: .*in use"):
            await streams.open(VideoAddress("127.0.0.1", taken.getsockname()[1]))
