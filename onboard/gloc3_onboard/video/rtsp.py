"""RTSP server (RFC 2326) for live video: RTP interleaved in the TCP connection, which passes every firewall and radio link.

Viewers that ask for UDP are answered with 461, upon which FFmpeg, OpenCV, GStreamer and VLC ask for TCP.
"""

import asyncio
import contextlib
import struct
from collections.abc import Callable, Mapping
from secrets import token_hex
from typing import Final, Protocol
from urllib.parse import urlsplit

from gloc3_onboard.video.encoder import is_control

MOST_VIEWERS: Final = 8
MOST_BYTES: Final = 8_192
"""Longest request."""
BACKLOG_BYTES: Final = 1_000_000
"""A viewer that is so far behind misses pictures."""
IDLE_S: Final = 60.0
"""A connection that does not watch, and requests nothing for so long, is closed."""
_REASONS: Final = {
    200: "OK",
    400: "Bad Request",
    404: "Not Found",
    405: "Method Not Allowed",
    453: "Not Enough Bandwidth",
    455: "Method Not Valid in This State",
    461: "Unsupported Transport",
}
_METHODS: Final = "OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN, GET_PARAMETER"


class Watchable(Protocol):
    """A camera's video."""

    media: tuple[str, ...]
    """Lines of its session description."""

    def watch(self, viewer: Callable[[list[bytes]], None]) -> Callable[[], None]:
        """Has the packets of each picture sent to a viewer, a whole picture first; returns a function that ends this."""


class RtspServer:
    """Serves videos by name.

    Args:
        videos: the cameras' videos; `rtsp://HOST:PORT/NAME` is one.
    """

    def __init__(self, videos: Mapping[str, Watchable]) -> None:
        self._videos = videos
        self._viewers: set[_Viewer] = set()
        self._server: asyncio.Server | None = None

    @property
    def port(self) -> int:
        """The port in use."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def open(self, host: str, port: int) -> None:
        """Listens; raises `OSError` where the address cannot be had."""
        self._server = await asyncio.start_server(self._connected, host, port, limit=MOST_BYTES)

    def close(self) -> None:
        """Ends all connections."""
        if self._server is not None:
            self._server.close()
        for viewer in list(self._viewers):
            viewer.close()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        viewer = _Viewer(self._videos, writer)
        if len(self._viewers) >= MOST_VIEWERS:
            writer.write(_answer(453, "0"))
            writer.close()
            return
        self._viewers.add(viewer)
        try:
            await viewer.serve(reader)
        finally:
            viewer.close()
            self._viewers.discard(viewer)


class _Viewer:
    """One connection."""

    def __init__(self, videos: Mapping[str, Watchable], writer: asyncio.StreamWriter) -> None:
        self._videos, self._writer = videos, writer
        self._session = token_hex(8)
        self._channel: int | None = None
        self._video: Watchable | None = None
        self._unwatch: Callable[[], None] | None = None

    async def serve(self, reader: asyncio.StreamReader) -> None:
        """Answers requests until the connection ends."""
        with contextlib.suppress(asyncio.IncompleteReadError, asyncio.LimitOverrunError, OSError):
            while not self._writer.is_closing():
                async with asyncio.timeout(IDLE_S if self._unwatch is None else None):
                    first = await reader.readexactly(1)
                if first == b"$":  # reports of the viewer
                    _, size = struct.unpack(">BH", await reader.readexactly(3))
                    await reader.readexactly(size)
                    continue
                text = first + await reader.readuntil(b"\r\n\r\n")
                self._writer.write(self._answered(text.decode("latin-1")))
                await self._writer.drain()

    def close(self) -> None:
        """Sends nothing any more."""
        self._pause()
        self._writer.close()

    def _pause(self) -> None:
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    def _answered(self, text: str) -> bytes:
        first, *lines = text.split("\r\n")
        words = first.split()
        headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        number = headers.get("cseq", "0")
        if len(words) != 3 or not words[2].startswith("RTSP/") or not number.isdecimal():
            return _answer(400, "0")
        method, url, _ = words
        name = urlsplit(url).path.strip("/").partition("/")[0]
        match method:
            case "OPTIONS":
                return _answer(200, number, f"Public: {_METHODS}")
            case "GET_PARAMETER":
                return _answer(200, number, f"Session: {self._session}")
            case "TEARDOWN":
                self._pause()
                return _answer(200, number, f"Session: {self._session}")
            case "DESCRIBE" | "SETUP" | "PLAY" if name not in self._videos:
                return _answer(404, number)
            case "DESCRIBE":
                return _answer(
                    200, number, f"Content-Base: {url.rstrip('/')}/", body=_description(name, self._videos[name].media)
                )
            case "SETUP":
                return self._set_up(number, name, headers.get("transport", ""))
            case "PLAY":
                return self._play(number)
        return _answer(405, number, f"Allow: {_METHODS}")

    def _set_up(self, number: str, name: str, transport: str) -> bytes:
        wanted = next((one for one in transport.split(",") if one.strip().startswith("RTP/AVP/TCP")), None)
        if wanted is None:
            return _answer(461, number)
        options = dict(part.partition("=")[::2] for part in wanted.split(";"))
        first = options.get("interleaved", "0-1").partition("-")[0]
        if not first.isdecimal() or int(first) > 254:
            return _answer(461, number)
        self._channel, self._video = int(first), self._videos[name]
        spoken = f"RTP/AVP/TCP;unicast;interleaved={first}-{int(first) + 1}"
        return _answer(200, number, f"Transport: {spoken}", f"Session: {self._session};timeout=60")

    def _play(self, number: str) -> bytes:
        if self._video is None:
            return _answer(455, number)
        if self._unwatch is None:
            self._unwatch = self._video.watch(self._send)
        return _answer(200, number, f"Session: {self._session}", "Range: npt=0.000-")

    def _send(self, packets: list[bytes]) -> None:
        """Sends a picture, unless earlier ones still wait."""
        if self._writer.is_closing() or self._channel is None:
            return
        if self._writer.transport.get_write_buffer_size() < BACKLOG_BYTES:
            heads = (struct.pack(">cBH", b"$", self._channel + is_control(one), len(one)) for one in packets)
            self._writer.write(b"".join(part for pair in zip(heads, packets, strict=True) for part in pair))


def _answer(status: int, number: str, *headers: str, body: str = "") -> bytes:
    about = ("Content-Type: application/sdp", f"Content-Length: {len(body)}") if body else ()
    lines = (f"RTSP/1.0 {status} {_REASONS[status]}", f"CSeq: {number}", "Server: GLOC3", *headers, *about)
    return ("\r\n".join((*lines, "", "")) + body).encode("latin-1")


def _description(name: str, media: tuple[str, ...]) -> str:
    """Session description (RFC 8866); the sets of parameters come with each whole picture."""
    lines = (
        "v=0",
        "o=- 0 0 IN IP4 0.0.0.0",
        f"s={name}",
        "c=IN IP4 0.0.0.0",
        "t=0 0",
        "a=control:*",
        *media,
        "a=control:video",
        "",
    )
    return "\r\n".join(lines)
