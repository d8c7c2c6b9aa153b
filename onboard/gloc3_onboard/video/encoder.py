"""Pictures as H.264 in RTP packets, alone or in MPEG-TS with their poses, by FFmpeg's encoder and muxers (PyAV)."""

import struct
from contextlib import suppress
from fractions import Fraction
from random import getrandbits
from typing import Any, Final, NamedTuple

import numpy as np

from gloc3.messages.vehicle import Image

PAYLOAD_TYPE: Final = 96
TRANSPORT_TYPE: Final = 33
"""MPEG-TS."""
TRANSPORT_BYTES: Final = 7 * 188
CLOCK_HZ: Final = 90_000
PACKET_BYTES: Final = 1_400
KEY_FRAME_S: Final = 1.0
"""Longest time for which a viewer who joins waits for a whole picture, s."""
BIT_RATE: Final = 2_000_000
_RATE_HZ: Final = 15
"""Assumed rate of pictures, for the encoder's budget; they may come at any."""
SOFTWARE: Final = "libx264"
ENCODERS: Final[dict[str, dict[str, str]]] = {
    "h264_v4l2m2m": {},
    "h264_nvenc": {"preset": "p1", "tune": "ull", "zerolatency": "1", "delay": "0"},
    SOFTWARE: {"preset": "veryfast", "tune": "zerolatency", "profile": "baseline"},
}
"""With their options, in the order in which they are tried: those of Linux's video drivers and of NVIDIA in hardware."""
_CONTROL: Final = range(200, 205)
"""Packet types of RTCP, which share the packetizer's output."""


class EncodedPicture(NamedTuple):
    """Packets of one picture."""

    video: list[bytes]
    """RTP and RTCP of H.264."""
    transport: list[bytes]
    """RTP of MPEG-TS with H.264 and KLV."""


class VideoEncoder:
    """Encodes pictures of one size. Not for two threads at once.

    Args:
        width: columns, even.
        height: rows, even.
    """

    def __init__(self, width: int, height: int) -> None:
        self._av = load_av()
        self.size: Final = (width, height)
        self._packets: list[bytes] = []
        options = {"packetsize": str(PACKET_BYTES), "payload_type": str(PAYLOAD_TYPE)}
        self._container: Any = self._av.open(self, "w", format="rtp", options=options)
        self.codec: Final = first_working(self._av, width, height)
        """FFmpeg's name of it."""
        stream = self._stream = self._container.add_stream(self.codec, rate=_RATE_HZ, options=ENCODERS[self.codec])
        _set_up(stream.codec_context, width, height)
        self._packed = _TransportPackets()
        self._transport: Any = self._av.open(self._packed, "w", format="mpegts", options={"flush_packets": "1"})
        self._in_transport = self._transport.add_stream_from_template(stream)
        self._poses = self._transport.add_data_stream("klv")
        self._last = -1

    def write(self, data: bytes) -> int:
        """Takes one packet of the packetizer."""
        self._packets.append(bytes(data))
        return len(data)

    def encode(self, image: Image, t_s: float, pose: bytes = b"", *, is_key: bool) -> EncodedPicture:
        """Packets of one picture.

        Args:
            image: in colour or grey.
            t_s: its time; earlier ones than the last are moved behind it.
            pose: a KLV local set; empty if unknown.
            is_key: whether it must be decodable without earlier ones.
        """
        shape = (image.height, image.width)
        if image.bgr:
            pixels = np.frombuffer(image.bgr, np.uint8).reshape(*shape, 3)
        else:
            pixels = np.frombuffer(image.data, np.uint8).reshape(shape)
        width, height = self.size
        frame = self._av.VideoFrame.from_ndarray(
            np.ascontiguousarray(pixels[:height, :width]), format="bgr24" if image.bgr else "gray"
        )
        self._last = max(round(t_s * CLOCK_HZ), self._last + 1)
        frame.pts, frame.time_base = self._last, Fraction(1, CLOCK_HZ)
        if is_key:
            frame.pict_type = self._av.video.frame.PictureType.I
        if pose:
            self._pack(pose, self._poses)
        for packet in self._stream.encode(frame):
            self._pack(bytes(packet), self._in_transport, is_key=packet.is_keyframe)
            self._container.mux(packet)
        found, self._packets = self._packets, []
        return EncodedPicture(found, self._packed.packets(self._last))

    def _pack(self, data: bytes, stream: Any, *, is_key: bool = True) -> None:
        """Puts data of the current picture into the transport stream."""
        packet = self._av.Packet(data)
        packet.stream, packet.is_keyframe = stream, is_key
        packet.pts = packet.dts = self._last
        packet.time_base = Fraction(1, CLOCK_HZ)
        self._transport.mux(packet)

    def close(self) -> None:
        """Frees the encoder."""
        self._container.close()
        self._transport.close()
        self._packets.clear()


class _TransportPackets:
    """Takes a transport stream and gives RTP packets (RFC 2250)."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._sequence, self._source = getrandbits(16), getrandbits(32)

    def write(self, data: bytes) -> int:
        """Takes a piece of the stream, whole packets."""
        self._data += data
        return len(data)

    def packets(self, timestamp: int) -> list[bytes]:
        """RTP packets of what has come since the last time."""
        found = []
        for begin in range(0, len(self._data), TRANSPORT_BYTES):
            self._sequence = self._sequence + 1 & 0xFFFF
            head = struct.pack(">BBHII", 0x80, TRANSPORT_TYPE, self._sequence, timestamp & 0xFFFFFFFF, self._source)
            found.append(head + self._data[begin : begin + TRANSPORT_BYTES])
        self._data.clear()
        return found


def first_working(av: Any, width: int, height: int) -> str:
    """The first encoder that gives a picture of this size back at once; x264 on the processor always does."""
    for name, options in ENCODERS.items():
        with suppress(av.FFmpegError, ValueError):  # there is no such hardware, or it cannot do this
            trial = av.CodecContext.create(name, "w")
            trial.options, trial.framerate = options, _RATE_HZ
            _set_up(trial, width, height)
            frame = av.VideoFrame(width, height, "yuv420p")
            frame.pts, frame.time_base = 0, Fraction(1, CLOCK_HZ)
            if trial.encode(frame):
                return name
    return SOFTWARE


def _set_up(context: Any, width: int, height: int) -> None:
    context.width, context.height, context.pix_fmt, context.bit_rate = width, height, "yuv420p", BIT_RATE
    context.time_base = Fraction(1, CLOCK_HZ)
    context.gop_size = round(_RATE_HZ * KEY_FRAME_S)


def load_av() -> Any:
    """PyAV; where it is missing, the program names the extra that brings it."""
    import av
    import av.video.frame

    return av


def is_control(packet: bytes) -> bool:
    """Whether a packet is RTCP."""
    return packet[1] in _CONTROL
